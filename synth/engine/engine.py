"""The engine's Python face: what a plugin host would call.

    engine = Engine([load_preset("tanpura")])
    engine.prepare(44100.0, 256)
    engine.process(events, out)

Python prepares (plan, compile, bank); `process` hands a block to the native core, which is the same offline and live.
"""

from __future__ import annotations

import hashlib
import io
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from synth.compile import CompiledPart, compile_preset
from synth.dsp.decimator import LATENCY_FRAMES
from synth.dsp.limiter import LOOKAHEAD, LimiterState, largest_reduction_db, release_coefficient
from synth.engine import layout
from synth.engine.advance import entries
from synth.engine.bank import build_bank, default_parameters, new_scratch, new_shared, new_state, span_quanta
from synth.engine.events import EVENT
from synth.engine.layout import Bank, Scratch, Settings, Shared, State
from synth.engine.notes import set_zone
from synth.engine.parameters import GAIN_SMOOTHING_S, Bindings, Parameter, bound_rows, parameters_of
from synth.engine.process import process
from synth.engine.team import Team, cores
from synth.engine.views import table
from synth.engine.zones import LOWER, MOST_MEMBERS
from synth.preset import Preset, playable_range
from synth.solver.laws import law_of
from synth.units import LN_1000, db_to_gain, hz_to_midi, midi_to_note

DC_BLOCK_HZ = 8.0
#: the limiter holds the mix this far below full scale, where every file format can hold it [dBFS]
CEILING_DB = -0.1


class Unplayed(NamedTuple):
    """Notes that found no string. `part` is −1 for a channel without a part."""

    part: int
    note: int
    times: int
    reason: str


@dataclass(frozen=True)
class EngineReport:
    """What has happened since `reset`."""

    peak: float
    limiter_reduction_db: float
    strings_sounding: int
    most_strings: int
    notes: int
    unplayed: tuple[Unplayed, ...]
    stolen: int
    taken_over: int
    events_dropped: int
    mode_steps: int
    unsolved_contacts: int


class Engine:
    """Presets as parts of one instrument; see the module's docstring.

    parts        one preset per part
    program_map  (16, 128) part of each channel and program, −1 for none; default: part p on channel p, or the only part
                 on every channel
    note_hz      (128,) frequencies that replace the presets' equal temperament
    bindings     controller → live parameter that it sets, of the parts its channel plays: an id, or rows (part or None for
                 all, id, value at 0, value at 127), None for the parameter's own range
    only_notes   of each part: the notes it will be asked for; None: all. Strings without any are left out, and unless
                 every_fret what else can be played on the others. No effect on the sound of those notes
    mpe          begin with an MPE zone of 15 members, as if the MPE configuration message had come on channel 1
    threads      how many compute, the caller of `process` included; "auto": one per processor. No effect on the sound
    Raises ValueError (PresetError among them) for what cannot be played.
    """

    def __init__(
        self,
        parts: Sequence[Preset],
        program_map: np.ndarray | None = None,
        *,
        quality: str = "standard",
        scheme: str = "exact-hold",
        restitution: float = 0.0,
        internal_rate_hz: float | None = None,
        limiter: bool = True,
        gain_db: float = 0.0,
        max_polyphony: int | None = None,
        note_hz: np.ndarray | None = None,
        economy: bool | None = None,
        only_notes: Sequence[set[int] | None] | None = None,
        every_fret: bool = True,
        threads: int | str = 1,
        bindings: Bindings | None = None,
        mpe: bool = False,
    ) -> None:
        if not parts:
            raise ValueError("an engine needs at least one preset")
        if not 0.0 <= restitution <= 1.0:
            raise ValueError(f"restitution must lie between 0 and 1, got {restitution:g}")
        if max_polyphony is not None and max_polyphony < 1:
            raise ValueError(f"polyphony must be at least 1, got {max_polyphony}")
        if threads != "auto" and not (isinstance(threads, int) and threads >= 1):
            raise ValueError(f"threads must be a whole number from 1 on or 'auto', got {threads!r}")
        self.parts = tuple(parts)
        if program_map is None:
            program_map = np.full((16, 128), 0 if len(parts) == 1 else -1)
            if len(parts) > 1:
                for p in range(min(16, len(parts))):
                    program_map[p] = p
        self.program_map = np.array(program_map, dtype=np.int64)
        if self.program_map.shape != (16, 128):
            raise ValueError(f"program_map must be (16, 128), got {self.program_map.shape}")
        if self.program_map.max() >= len(parts):
            raise ValueError(f"program_map names part {self.program_map.max()}, there are {len(parts)}")
        channels = []
        for p in range(len(parts)):
            of_part = np.flatnonzero((self.program_map == p).any(axis=1))
            channels.append(int(of_part[0]) if of_part.size else 0)
        self._channels = channels
        self.quality = quality
        self.scheme = scheme
        self.restitution = float(restitution)
        self.internal_rate_hz = internal_rate_hz
        self.limiter = limiter
        self.gain_db = gain_db
        self.max_polyphony = max_polyphony
        self.note_hz = note_hz
        self.economy = quality in ("draft", "standard") if economy is None else economy
        self._only_notes = only_notes
        self._every_fret = every_fret
        self.rate_hz = 0.0
        self.threads = threads
        self.mpe = mpe
        self._bindings = bound_rows(bindings or {}, self.parts)
        self._bank: Bank | None = None
        self._team: Team | None = None

    def prepare(self, rate_hz: float, max_block: int = 4096) -> None:
        """Compile every playable note for an output rate [Hz], compile the kernels, reset. `max_block` [frames]."""
        if max_block < 1:
            raise ValueError(f"max_block must be at least 1 frame, got {max_block}")
        self.close()
        self._bank = None  # until all is there: `process` works on addresses
        self.rate_hz = float(rate_hz)
        self.max_block = int(max_block)
        cache: dict[tuple, CompiledPart] = {}
        compiled = []
        for p, preset in enumerate(self.parts):
            wanted = self._only_notes[p] if self._only_notes is not None else None
            key = (id(preset), None if wanted is None else frozenset(wanted))
            if key not in cache:
                cache[key] = compile_preset(
                    preset,
                    quality=self.quality,
                    rate_hz=self.rate_hz,
                    scheme=self.scheme,
                    internal_rate_hz=self.internal_rate_hz,
                    note_hz=self.note_hz,
                    only_notes=wanted,
                    every_fret=self._every_fret,
                )
            compiled.append(cache[key])
        self.compiled = tuple(compiled)
        law = law_of(self.scheme)
        bank = build_bank(
            compiled, self._channels, self.program_map, self.rate_hz, law, self._compiled_pitch(), self._bindings
        )
        polyphony = self.max_polyphony or sum(preset.mapping.polyphony for preset in self.parts)
        self._settings = Settings(
            law,
            self.restitution,
            self.rate_hz,
            int(self.limiter),
            db_to_gain(CEILING_DB),
            release_coefficient(self.rate_hz),
            db_to_gain(self.gain_db),
            polyphony,
            -math.expm1(-1.0 / (GAIN_SMOOTHING_S * self.rate_hz)),
            math.exp(-2.0 * math.pi * DC_BLOCK_HZ / self.rate_hz),
            int(self.economy),
            span_quanta(compiled),
        )
        self._shared: Shared = new_shared(bank, self._settings.span, entries())
        self._scratch: Scratch = new_scratch(bank)
        self._desk = table(self._scratch)
        self._state: State = new_state(bank, self._settings.span, default_parameters(compiled))
        self._core = table(bank, self._state, self._shared, self._settings)
        self._bank = bank
        self._make_team()
        self.reset()
        self.process(np.zeros(0, EVENT), np.zeros((2 * layout.QUANTUM, 2)))
        self.reset()

    def reset(self) -> None:
        """Silence, controllers at their power-up values, counters at zero."""
        bank = self._prepared()
        for mine, fresh in zip(
            self._state, new_state(bank, self._settings.span, default_parameters(self.compiled)), strict=True
        ):
            mine[: len(fresh)] = fresh
        self._state.part_state["left"] = self._state.part_state["right"] = self._settings.gain
        # a channel begins with the lowest program that it has a part for
        self._state.channels["program"] = (self.program_map >= 0).argmax(axis=1)

        if self.mpe:
            set_zone(self._core.ctypes.data, self._desk.ctypes.data, LOWER, MOST_MEMBERS)

    def _compiled_pitch(self) -> np.ndarray:
        """(128,) pitch of every key [semitones]; of a preset with another concert pitch it is its own equal temperament."""
        pitch = np.arange(128.0)
        if self.note_hz is not None:
            given = np.flatnonzero(np.isfinite(self.note_hz) & (np.asarray(self.note_hz) > 0.0))
            pitch[given] = [hz_to_midi(float(self.note_hz[key])) for key in given]
        return pitch

    def _make_team(self) -> None:
        """Start the workers, as many as there are threads beside the caller's and strings for them."""
        bank = self._prepared()
        wanted = cores() if self.threads == "auto" else int(self.threads)
        workers = min(wanted, bank.strings.size) - 1
        if workers > 0:
            self._worker_scratch = [new_scratch(bank) for _ in range(workers)]
            desks = [table(scratch) for scratch in self._worker_scratch]
            keep = (bank, self._state, self._shared, self._worker_scratch)
            self._team = Team(self, self._core, self._shared.team, desks, keep)

    def close(self) -> None:
        """End the threads beside the caller's; the engine can go on with one. Collected or at exit it does so by itself.

        Threads do not survive a fork: a child that goes on playing must `prepare` anew.
        """
        if self._team is not None:
            self._team.end()
            self._team = None

    def _prepared(self) -> Bank:
        if self._bank is None:
            raise ValueError("call prepare(rate_hz, max_block) first")
        return self._bank

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None = None) -> None:
        """One block. events: EVENT array, frames from 0 to the block's length, in order. out: (frames, 2) float64,
        overwritten. stems: (parts, frames, 2) or None, overwritten with every part before the limiter."""
        self._prepared()
        room = self._state.pending.size - int(self._state.counters[layout.PENDING])
        if events.size > room:  # more events in one block than the queue holds: a larger queue
            self._grow_queue(2 * (self._state.pending.size + events.size))
        if out.ndim != 2 or out.shape[1] != 2 or out.dtype != np.float64 or not out.flags.c_contiguous:
            raise ValueError(f"out must be a contiguous (frames, 2) float64 array, got {out.shape} {out.dtype}")
        if stems is None:
            stems = np.zeros((0, 0, 2))
        elif stems.shape != (len(self.parts), *out.shape):
            raise ValueError(f"stems must be ({len(self.parts)}, {out.shape[0]}, 2), got {stems.shape}")
        process(self._core.ctypes.data, self._desk.ctypes.data, events, out, stems)

    @property
    def addresses(self) -> tuple[int, int]:
        """What the native `process` takes as `core` and `desk`, valid until the next `prepare`."""
        self._prepared()
        return self._core.ctypes.data, self._desk.ctypes.data

    @property
    def strings_sounding(self) -> int:
        return int(self._state.sounding["awake"].sum())

    @property
    def events_dropped(self) -> int:
        """Events that found the queue full."""
        return int(self._state.counters[layout.N_DROPPED])

    @property
    def expressions(self) -> dict[int, int]:
        """Channels whose volume and expression count for a part now, with the value of controller 11 there."""
        channels = {int(part["channel"]) for part in self._state.part_state}
        return {c: round(127.0 * math.sqrt(self._state.channels[c]["expression"])) for c in sorted(channels)}

    @property
    def gains(self) -> list[float]:
        """The live parameter output.gain of every part as it is now."""
        self._prepared()
        return self._state.parameters[:, layout.GAIN].tolist()

    @property
    def latency_samples(self) -> int:
        """Frames from an event to the moment the string feels it."""
        return layout.QUANTUM + LATENCY_FRAMES + (LOOKAHEAD if self.limiter else 0)

    @property
    def tail_seconds(self) -> float:
        """Time to −60 dB of the string that rings longest when nothing damps it, at most 60 s."""
        slowest = min(
            (float(position.sigma.min()) for part in self.compiled for s in part.strings for position in s.positions),
            default=1.0,
        )
        return min(60.0, LN_1000 / max(slowest, 1e-3))

    @property
    def silent(self) -> bool:
        """No string is awake and no event waits."""
        return not (self._state.sounding["awake"].any() or self._state.counters[layout.PENDING])

    @property
    def spare(self) -> float:
        """Output level (linear) below which a string that no key holds is damped away; 0: none is. `reset` sets it to 0."""
        return float(self._state.meters[layout.SPARE])

    @spare.setter
    def spare(self, level: float) -> None:
        if not 0.0 <= level < math.inf:
            raise ValueError(f"the level below which strings are spared must be 0 or more, got {level:g}")
        self._prepared()
        self._state.meters[layout.SPARE] = level

    def reserve(self, events: int) -> None:
        """Room for at least so many events that wait, for callers of the native core, which cannot make any."""
        self._prepared()
        if events > self._state.pending.size:
            self._grow_queue(events)

    @property
    def parameters(self) -> list[Parameter]:
        """Live parameters of every part."""
        return [parameter for p, preset in enumerate(self.parts) for parameter in parameters_of(p, preset)]

    def get_state(self) -> bytes:
        """Everything that sounds, to be given back to `set_state` of an engine prepared in the same way."""
        buffer = io.BytesIO()
        np.savez(buffer, bank=self._fingerprint(), **self._state._asdict())
        return buffer.getvalue()

    def _fingerprint(self) -> np.ndarray:
        """(16,) bytes that tell banks and settings apart."""
        digest = hashlib.blake2b(repr(self._settings).encode(), digest_size=16)
        for array in self._prepared():
            digest.update(array.tobytes())
        return np.frombuffer(digest.digest(), np.uint8)

    def set_state(self, data: bytes) -> None:
        """Go on from a state. Raises ValueError where it belongs to another bank."""
        try:
            with np.load(io.BytesIO(data)) as loaded:
                origin = loaded["bank"]
                fields = {name: loaded[name] for name in State._fields}
        except (KeyError, OSError, EOFError, ValueError, BadZipFile, zlib.error) as error:
            raise ValueError(f"not a state of this engine: {error}") from None
        if not np.array_equal(origin, self._fingerprint()):
            raise ValueError("the state comes from other presets, rate or quality; prepare the engine in the same way")
        for name, mine in self._state._asdict().items():
            fits = fields[name].ndim == 1 if name == "pending" else fields[name].shape == mine.shape
            if fields[name].dtype != mine.dtype or not fits:
                raise ValueError(f"the state's {name} does not fit: it comes from other presets, rate or quality")
        if fields["pending"].size != self._state.pending.size:
            self._set_queue(fields["pending"])
        for name, mine in self._state._asdict().items():
            mine[:] = fields[name]

    def _grow_queue(self, size: int) -> None:
        bigger = np.zeros(size, EVENT)
        bigger[: self._state.pending.size] = self._state.pending
        self._set_queue(bigger)

    def _set_queue(self, pending: np.ndarray) -> None:
        """Another array for the events that wait."""
        state = self._state._replace(pending=np.ascontiguousarray(pending))
        self._core[:] = table(self._prepared(), state, self._shared, self._settings)
        self._state = state

    @property
    def mode_steps(self) -> int:
        """Work done since reset: modes × internal steps."""
        return int(self._state.sounding["mode_steps"].sum())

    def report(self) -> EngineReport:
        """What has happened since `reset`."""
        state = self._state
        counters = state.counters
        unplayed = []
        for p, note in np.argwhere(state.unplayed > 0):
            count = int(state.unplayed[p, note])
            if p == len(self.parts):
                unplayed.append(Unplayed(-1, int(note), count, "its channel has no preset"))
                continue
            low, high = playable_range(self.parts[p])
            reason = (
                f"outside {midi_to_note(low)}-{midi_to_note(high)}"
                if not low <= note <= high
                else "no string is tuned to it"
            )
            unplayed.append(Unplayed(int(p), int(note), count, reason))
        limiter = LimiterState(state.delay, state.required, state.released, state.limiter_counters, state.limiter_levels)
        return EngineReport(
            float(state.meters[layout.PEAK]),
            largest_reduction_db(limiter) if self.limiter else 0.0,
            int(state.sounding["awake"].sum()),
            int(counters[layout.MOST_AWAKE]),
            int(counters[layout.N_NOTES]),
            tuple(unplayed),
            int(counters[layout.N_STOLEN]),
            int(counters[layout.N_TAKEN]),
            int(counters[layout.N_DROPPED]),
            self.mode_steps,
            int(state.sounding["unsolved"].sum()),
        )
