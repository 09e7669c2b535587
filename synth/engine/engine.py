"""The engine's Python face: what a plugin host would call.

    engine = Engine([load_preset("tanpura")])
    engine.prepare(44100.0, 256)
    engine.process(events, out)

Python prepares (plan, compile, bank); `process` hands a block to the native core, which is the same offline and live.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar, Unpack

import numpy as np

from synth.dsp.decimator import LATENCY_FRAMES
from synth.dsp.limiter import largest_reduction_db
from synth.engine import arguments, layout
from synth.engine.bank import (
    Strings,
    build_bank,
    default_parameters,
    new_scratch,
    new_shared,
    new_sounding,
    new_state,
    new_stream,
    span_quanta,
)
from synth.engine.effect_chains import Chains
from synth.engine.engine_settings import EngineOptions, EngineSettings
from synth.engine.excite import Excitations
from synth.engine.hands import voices_for
from synth.engine.layout import CORE_PARTS, Bank, Effects, Settings, Shared, Sounding, SpanWork, State, Stream
from synth.engine.memory_map import EngineMemory
from synth.engine.numbers import a_count, a_number
from synth.engine.parameters import GAIN_SMOOTHING_S, Bindings, Parameter, bound_rows, parameters_of
from synth.engine.process import process
from synth.engine.tasks import entries
from synth.engine.team import ATTEND, Team
from synth.engine.uncopied import Uncopied
from synth.engine.voices import policy
from synth.engine.voices.mpe import set_zone
from synth.instrument.check import check
from synth.instrument.compile import CompiledPart, CompiledString, compile_preset, wanted_notes
from synth.instrument.effects import EffectTable
from synth.instrument.plan import planned_precision
from synth.instrument.preset import Preset, PresetError, why_unplayed
from synth.instrument.qualities import FLOAT32
from synth.jit import compiling, kernel_helpers, prebuilt
from synth.jit.entries import entry
from synth.midi.events import EVENT
from synth.midi.zones import LOWER, MOST_MEMBERS
from synth.native.arrays import bytes_of
from synth.native.processors import cores
from synth.native.views import table, words
from synth.solver.schemes import energy_warning
from synth.units import LN_1000, db_to_gain, hz_to_midi

DC_BLOCK_HZ = 8.0
#: the limiter holds the mix this far below full scale, where every file format can hold it [dBFS]
CEILING_DB = -0.1
#: as many events may wait, 64 MB of them
MOST_EVENTS = 1 << 21
#: longest block [frames]
MOST_BLOCK = 1 << 24
#: the stems of a call without any: (parts, frames, channels)
_NO_STEMS = np.zeros((0, 0, 2))


#: what an observer writes: a NamedTuple as `native.arrays` declares them
_Records = TypeVar("_Records")


class Unplayed(NamedTuple):
    """Notes that found no string. `part` is −1 for a channel without a part."""

    part: int
    note: int
    times: int
    reason: str


@dataclass(frozen=True)
class EngineReport:
    """What an engine counted since `reset`, given by `Engine.report`.

    Attributes
    ----------
    peak : float
        Largest sample, linear, full scale 1.
    limiter_reduction_db : float
        The limiter's largest reduction [dB]; 0 without one.
    strings_sounding, most_strings : int
        Strings that sound now, and the most that did at once.
    notes : int
        Notes that began.
    unplayed : tuple of Unplayed
        Notes that found no string: part (−1 for a channel without one), note, times, reason.
    stolen, taken_over : int
        Strings that yielded to others; notes that took over a string whose key was held.
    events_dropped : int
        Events that found the queue full.
    mode_steps : int
        Modes × internal steps.
    unsolved_contacts : int
        Steps whose contact forces were not solved exactly.
    silenced : int
        How often a string whose motion had blown up, or a part whose filters held no sound any more, was silenced
        (`advance.TOO_FAR`, `layout.BLOWN_UP`).

    Examples
    --------
    >>> import synth
    >>> engine = synth.Engine(["tanpura"], quality="draft")
    >>> engine.prepare(44100.0, 256)
    >>> engine.report().notes, engine.report().unplayed
    (0, ())
    >>> engine.close()
    """

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
    silenced: int


class Engine(Uncopied):
    """Presets as parts of one instrument, played block by block as in an audio callback.

    Parameters
    ----------
    parts : sequence of Preset, str or path
        One preset per part: itself, its name or its file.
    program_map : (16, 128) array of int, optional
        Part of each channel and program, −1 for none; default: part p on channel p, or the only part on every channel.
    settings : EngineSettings, optional
        How it computes and how loud it is, whatever the parts.
    note_hz : (128,) array, optional
        Frequencies that replace the presets' equal temperament [Hz].
    only_notes : sequence of set or None, optional
        Of each part: the notes it will be asked for; None: all. Strings without any are left out. No effect on the sound of
        those notes.
    every_fret : bool
        With `only_notes`: whether what else can be played on their strings is kept.
    bindings : dict, optional
        Controller → live parameter that it sets, of the parts its channel plays: an id, or rows (part or None for all, id,
        value at 0, value at 127), None for the parameter's own range.
    mix_effects : sequence of tables
        Effects of the mix, in this order before the limiter: tables as in presets.
    policy : callable
        Who plays a note and who yields, as the native core calls it (`voices.policy`).
    warn : callable, optional
        Told by `prepare` what may go wrong (a scheme that can gain energy at its rate, `schemes.energy_warning`); None:
        Python's warnings are, as RuntimeWarning.
    max_polyphony : int, optional
        The name of the setting `polyphony` up to version 0.19.
    **options
        Fields of `EngineSettings` by name, in the place of those in `settings`.

    Raises
    ------
    ValueError
        For what cannot be played; PresetError is one.
    TypeError
        For arguments of another kind.

    Examples
    --------
    >>> import numpy as np
    >>> import synth
    >>> engine = synth.Engine(["tanpura"], quality="draft")
    >>> engine.prepare(44100.0, 256)
    >>> out = np.zeros((256, 2))
    >>> engine.process(synth.make_events([(10, synth.NOTE_ON, 0, 48, 100)]), out)
    >>> engine
    <Engine tanpura: draft, exact-hold, 44100 Hz, blocks of 256, 8 strings>
    >>> engine.close()
    """

    def __init__(
        self,
        parts: Sequence[Preset | str | os.PathLike[str]],
        program_map: np.ndarray | None = None,
        *,
        settings: EngineSettings | None = None,
        note_hz: np.ndarray | None = None,
        only_notes: Sequence[set[int] | None] | None = None,
        every_fret: bool = True,
        bindings: Bindings | None = None,
        mix_effects: Sequence[EffectTable] = (),
        policy: Callable[[int], None] = policy.decide,
        warn: Callable[[str], None] | None = None,
        max_polyphony: int | None = None,
        **options: Unpack[EngineOptions],
    ) -> None:
        self._bank: Bank | None = None
        self._team: Team | None = None
        self._observed: tuple[Any, Any] | None = None
        self.compiled: tuple[CompiledPart, ...] = ()
        self.parts = arguments.presets(parts)
        self.program_map = arguments.program_map(program_map, len(self.parts))
        if max_polyphony is not None:
            if options.get("polyphony") is not None:
                raise TypeError("polyphony and max_polyphony must not both be given: the second is the first's old name")
            options["polyphony"] = max_polyphony
        if settings is not None and not isinstance(settings, EngineSettings):
            raise TypeError(f"settings must be an EngineSettings, got {settings!r:.50}; give its fields by name: quality=…")
        self.settings = (EngineSettings() if settings is None else settings).of_engine(**options)
        channels = []
        for p in range(len(parts)):
            of_part = np.flatnonzero((self.program_map == p).any(axis=1))
            channels.append(int(of_part[0]) if of_part.size else 0)
        self._channels = channels
        self.mix_effects = arguments.effects(mix_effects)
        self.note_hz = arguments.note_frequencies(note_hz)
        chosen = self.settings
        self.precision = chosen.precision or planned_precision(chosen.quality, chosen.scheme, chosen.internal_rate_hz)
        self._only_notes = arguments.wanted_notes(only_notes, len(self.parts))
        self._every_fret = every_fret
        self.rate_hz = 0.0
        self.max_block = 0
        self._policy = arguments.a_function("policy", policy)
        self._given_bindings = dict(bindings or {})
        self._bindings = bound_rows(self._given_bindings, self.parts)
        self._warn = warn

    def __repr__(self) -> str:
        names = ", ".join(preset.name for preset in self.parts)
        if self._bank is None:
            state = "not prepared"
        else:
            strings = self._bank.strings.size
            state = f"{self.rate_hz:g} Hz, blocks of {self.max_block}, {strings} string{'' if strings == 1 else 's'}"
        return f"<Engine {names}: {self.settings.quality}, {self.settings.scheme}, {state}>"

    def prepare(self, rate_hz: float, max_block: int = 4096, progress: Callable[[int, int], None] | None = None) -> None:
        """Compile every playable note for an output rate [Hz], compile the kernels, reset. `max_block` [frames].

        progress: called with (strings that are compiled, all there are) after each of them.
        Raises ValueError or TypeError for a rate or block that cannot be, PresetError for notes that cannot be played.
        """
        rate_hz = arguments.rate(rate_hz)
        max_block = a_count("max_block", max_block, 1, MOST_BLOCK)
        self.close()
        self._bank = None  # until all is there: `process` works on addresses
        self.rate_hz = rate_hz
        self.max_block = max_block
        if prebuilt.found().path is None:
            listed = "coupled_kernels" if any(preset.coupled for preset in self.parts) else "kernels"
            kernel_helpers.compile_all(f"synth.engine.warmup:{listed}")
        cache: dict[tuple, CompiledPart] = {}
        compiled = []
        only = [None] * len(self.parts) if self._only_notes is None else self._only_notes
        wanted_strings = [wanted_notes(preset, notes) for preset, notes in zip(self.parts, only, strict=True)]
        strings: dict[tuple, CompiledString] = {}  # that parts share
        done, total = 0, sum(len(each) for each in wanted_strings)
        for p, preset in enumerate(self.parts):
            wanted = only[p]
            key = (id(preset), wanted)
            if key not in cache:
                try:
                    cache[key] = compile_preset(
                        preset,
                        quality=self.settings.quality,
                        rate_hz=self.rate_hz,
                        scheme=self.settings.scheme,
                        internal_rate_hz=self.settings.internal_rate_hz,
                        note_hz=self.note_hz,
                        only_notes=wanted,
                        every_fret=self._every_fret,
                        made=strings,
                        progress=None if progress is None else lambda here, before=done: progress(before + here, total),
                    )
                except PresetError:
                    check(preset, preset.name)  # says all that is wrong, where it is the preset's own doing
                    raise
            compiled.append(cache[key])
            done += len(wanted_strings[p])
        self.compiled = tuple(compiled)
        for text in self.warnings:
            if self._warn is None:
                warnings.warn(text, RuntimeWarning, stacklevel=2)
            else:
                self._warn(text)
        built = build_bank(
            compiled,
            self._channels,
            self.program_map,
            self.rate_hz,
            self.settings.scheme,
            self.settings.restitution,
            self._compiled_pitch(),
            self._bindings,
            single=self.precision == FLOAT32,
        )
        bank = built.bank
        ceiling = db_to_gain(CEILING_DB) if self.settings.limiter else None
        self._chains = Chains(self.parts, self.mix_effects, ceiling, self.rate_hz)
        polyphony = self.settings.polyphony or sum(preset.mapping.polyphony for preset in self.parts)
        self._core_settings = Settings(
            self.rate_hz,
            math.inf if ceiling is None else ceiling,
            self._chains.mix_latency,
            db_to_gain(self.settings.gain_db),
            polyphony,
            -math.expm1(-1.0 / (GAIN_SMOOTHING_S * self.rate_hz)),
            math.exp(-2.0 * math.pi * DC_BLOCK_HZ / self.rate_hz),
            int(self.settings.economises),
            span_quanta(compiled),
            self.settings.seed,
        )
        self._excitations = Excitations(self.parts)
        self._built = built
        self._strings = Strings(built)
        called = entries(bool(built.bodies), bool(built.boards))
        self._shared: Shared
        self._span: SpanWork
        self._shared, self._span = new_shared(bank, self._core_settings.span, called, self._strings)
        self._excitations.point(self._shared)
        self._scratch = new_scratch(bank), new_scratch(bank)
        self._thread_table = table(*self._scratch)
        parameters, at_rest = default_parameters(compiled), (bank, self._core_settings.span, self._chains.at_rest())
        self._state: State = new_state(bank, parameters)
        self._stream: Stream = new_stream(*at_rest)
        self._sounding: Sounding = new_sounding(bank)
        self._fresh = (*new_state(bank, parameters), *new_stream(*at_rest), *new_sounding(bank))
        self._effects: Effects
        self._effects, self._effect_tables = self._chains.bound(self._stream)
        self._core = self._core_table(bank)
        self._shared.task[layout.HANDLE] = policy.entry(self._policy).address
        self._observed = None
        self._bank = bank
        self._place_voices()
        self._make_team()
        self.reset()
        self.process(np.zeros(0, EVENT), np.zeros((2 * layout.QUANTUM, 2)))
        self.reset()

    @property
    def warnings(self) -> list[str]:
        """What may go wrong with this scheme at the internal rates that `prepare` has chosen."""
        plans = [(s.factor, position.omega) for part in self.compiled for s in part.strings for position in s.positions]
        if not plans:
            return []
        slowest = self.rate_hz * min(factor for factor, _ in plans)
        highest_hz = max(float(omega.max()) for _, omega in plans) / (2.0 * math.pi)
        risk = energy_warning(
            self.settings.scheme, self.settings.restitution, slowest, "internal_rate_hz", self.rate_hz, highest_hz
        )
        return [] if risk is None else [risk]

    @property
    def has_single(self) -> bool:
        """Whether any of its strings has its modes in float32: not those over boards, and where `precision` says so."""
        alone = any(model.single.on for model in self._strings.models)
        return alone or any(each.single for each in self._strings.bridges.couplings)

    def reset(self, seed: int | None = None) -> None:
        """Silence, controllers at their power-up values, counters at zero. seed: from now on the engine's; None: as before.

        Raises TypeError or ValueError for a seed that cannot be.
        """
        self._prepared()
        if seed is not None and seed != self.settings.seed:
            self.settings = replace(self.settings, seed=seed)
            self._core_settings = self._core_settings._replace(seed=self.settings.seed)
            settings, at = table(self._core_settings), sum(map(words, CORE_PARTS[: CORE_PARTS.index(Settings)]))
            self._core[at : at + settings.size] = settings
        for mine, fresh in zip((*self._state, *self._stream, *self._sounding), self._fresh, strict=True):
            bytes_of(mine[: len(fresh)])[:] = bytes_of(fresh)
        self._strings.reset()
        self._shared.task[layout.UNTIL] = 0
        self._state.part_state["left"] = self._state.part_state["right"] = self._core_settings.gain
        # a channel begins with the lowest program that it has a part for
        self._state.channels["program"] = (self.program_map >= 0).argmax(axis=1)

        if self.settings.mpe:
            set_zone(self._voices.ctypes.data, LOWER, MOST_MEMBERS)

    def _compiled_pitch(self) -> np.ndarray:
        """(128,) pitch of every key [semitones]; of a preset with another concert pitch it is its own equal temperament."""
        pitch = np.arange(128.0)
        if self.note_hz is not None:
            given = np.flatnonzero(np.isfinite(self.note_hz) & (np.asarray(self.note_hz) > 0.0))
            pitch[given] = [hz_to_midi(float(self.note_hz[key])) for key in given]
        return pitch

    def _core_table(self, bank: Bank) -> np.ndarray:
        """`layout.CORE_PARTS` as they now are."""
        changing = self._state, self._stream, self._sounding
        return table(bank, *changing, self._shared, self._span, self._core_settings, self._effects)

    def _place_voices(self) -> None:
        """Make the voice policy's table, which leads to the core's, and note where the core's and the thread's are."""
        self._addresses = self._core.ctypes.data, self._thread_table.ctypes.data
        seen = voices_for(self._prepared(), self._sounding, self._core_settings, *self._addresses)
        self._voices = table(seen, self._state)
        self._shared.task[layout.VOICES] = self._voices.ctypes.data

    def _make_team(self) -> None:
        """Start the workers, as many as there are threads beside the caller's and strings for them."""
        bank = self._prepared()
        wanted = cores() if self.settings.threads == "auto" else int(self.settings.threads)
        workers = min(wanted, bank.instruments.size) - 1
        if workers > 0:
            self._worker_scratch = [(new_scratch(bank), new_scratch(bank)) for _ in range(workers)]
            scratches = [table(*scratch) for scratch in self._worker_scratch]
            arrays = bank, self._state, self._stream, self._sounding, self._shared, self._span
            keep = (*arrays, self._strings, self._excitations, self._worker_scratch)
            self._team = Team(self, self._core, self._shared.team, scratches, keep)
        else:
            compiling.spares(ATTEND)

    def close(self) -> None:
        """End the threads beside the caller's; the engine can go on with one. Collected or at exit it does so by itself.

        Threads do not survive a fork: in the child one thread computes all, until `prepare` starts others.
        """
        if self._team is not None:
            self._team.end()
            self._team = None

    def _prepared(self) -> Bank:
        if self._bank is None:
            raise ValueError("the engine is not prepared; call prepare(rate_hz, max_block) first")
        return self._bank

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None = None) -> None:
        """One block. events: EVENT array, frames from 0 to the block's length, in order. out: (frames, 2) float64,
        overwritten. stems: (parts, frames, 2) or None, overwritten with every part before the limiter.

        Raises TypeError or ValueError, and does nothing, where one of them is not so, or an event is none that
        `synth.midi.events` knows (values of live parameters beyond their ranges are brought back inside).
        """
        self._prepared()
        out = arguments.output("out", out, (None, 2), "(frames, 2)")
        if stems is None:
            stems = _NO_STEMS
        else:
            shape = (len(self.parts), len(out), 2)
            stems = arguments.output("stems", stems, shape, str(shape))
        events = arguments.events(events, len(out), len(self.parts))
        room = self._stream.pending.size - int(self._state.counters[layout.PENDING])
        if events.size > room:  # more events in one block than the queue holds: a larger queue
            self._grow_queue(2 * (self._stream.pending.size + events.size))
        process(*self._addresses, events, out, stems)

    @property
    def addresses(self) -> tuple[int, int]:
        """What the native `process` takes as `core` and `thread`, valid until the next `prepare` or `observe`."""
        self._prepared()
        return self._addresses

    @property
    def memory(self) -> EngineMemory:
        """Arrays and tables of the engine as they now are (`EngineMemory`)."""
        self._prepared()
        return EngineMemory(
            self._built,
            self._state,
            self._stream,
            self._sounding,
            self._shared,
            self._span,
            self._core_settings,
            self._effects,
            self._chains,
            self._strings,
            self._excitations,
            self._scratch,
            self._core,
            self._thread_table,
            self._voices,
            self._effect_tables,
        )

    def observe(
        self, place: int, watch: Callable[[int, int, int, int], None], records: Callable[[int], _Records]
    ) -> _Records:
        """Put an observer in the place of a function that the engine calls, until the next `prepare`. Returns its records.

        To be called after `prepare`, before `addresses` are given to anybody and while nobody calls `process`.

        place    of the function in Shared.task: `layout.STEP` (core, thread, string, steps), of strings that share no bridge
                 and do not fly at the output rate (with economy=False none does), or `layout.TOGETHER` (core, thread,
                 instrument, –), of instruments whose strings share a bridge
        watch    a function of the same arguments, compiled here: it has the function's work done by `views.call_back`, at
                 once or in parts, and reads what it wants in between
        records  of the function's address, the NamedTuple that `watch` opens by `opener(Records, CORE_WORDS)`
        Raises ValueError for another place or one whose function is not called, for an engine that is observed already, or
        that several threads compute.
        """
        self._prepared()
        if place not in (layout.STEP, layout.TOGETHER):
            raise ValueError(
                f"place must be layout.STEP ({layout.STEP}) or layout.TOGETHER ({layout.TOGETHER}), got {place!r}"
            )
        if self._shared.task[place] == 0:
            raise ValueError("an engine observed at layout.TOGETHER must have strings that share a bridge, got none")
        if self._observed is not None:
            raise ValueError("an engine must have one observer, got a second; prepare it anew")
        if self._team is not None:
            raise ValueError(
                f"an observed engine must have one thread, got threads {self.settings.threads!r}; make it with threads=1"
            )
        kept = records(int(self._shared.task[place]))
        observer = entry(watch, 4)
        # behind the engine's tables, which it reads no further than their end
        self._core = np.concatenate([self._core, table(kept)])
        self._place_voices()
        self._shared.task[place] = observer.address
        self._observed = observer, kept
        return kept

    @property
    def strings_sounding(self) -> int:
        """How many strings sound, without those that are awake only because they share a bridge."""
        self._prepared()
        return int((self._sounding.voices["awake"] - self._sounding.voices["idle"]).sum())

    @property
    def struck(self) -> list[tuple[int, int]]:
        """Strings that have been struck since `reset`, each with the fret that it is stopped at now: (number among all
        parts' `compiled` strings, fret)."""
        bank, sounding = self._prepared(), self._sounding
        found = []
        firsts = np.flatnonzero(bank.strings["of_first"] == 0)
        for number, s in enumerate(firsts):
            if sounding.strokes["strokes"][s]:
                at = (bank.positions["string"] == s) & (bank.positions["model"] == sounding.hands["model"][s])
                found += [(number, int(fret)) for fret in bank.positions["fret"][at][:1]]
        return found

    @property
    def notes_unplayed(self) -> int:
        """Notes that found no string (see `report`)."""
        return int(self._state.unplayed.sum())

    @property
    def events_dropped(self) -> int:
        """Events that found the queue full."""
        self._prepared()
        return int(self._state.counters[layout.N_DROPPED])

    @property
    def expressions(self) -> dict[int, int]:
        """Channels whose volume and expression count for a part now, with the value of controller 11 there."""
        self._prepared()
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
        self._prepared()
        return layout.QUANTUM + LATENCY_FRAMES + self._chains.part_latency + self._chains.mix_latency

    @property
    def tail_seconds(self) -> float:
        """Time to −60 dB of the string that rings longest when nothing damps it, at most 60 s."""
        self._prepared()
        slowest = min(
            (float(position.sigma.min()) for part in self.compiled for s in part.strings for position in s.positions),
            default=1.0,
        )
        return min(60.0, LN_1000 / max(slowest, 1e-3))

    @property
    def silent(self) -> bool:
        """No string is awake and no event waits."""
        self._prepared()
        return not (self._sounding.voices["awake"].any() or self._state.counters[layout.PENDING])

    @property
    def spare(self) -> float:
        """Output level (linear) below which a string that no key holds is damped away; 0: none is. `reset` sets it to 0."""
        self._prepared()
        return float(self._state.meters[layout.SPARE])

    @spare.setter
    def spare(self, level: float) -> None:
        self._prepared()
        most = layout.BLOWN_UP  # no string's is higher
        self._state.meters[layout.SPARE] = a_number("the level below which strings are spared", level, 0.0, most)

    def reserve(self, events: int) -> None:
        """Room for at least so many events that wait, for callers of the native core, which cannot make any."""
        self._prepared()
        events = a_count("events", events, 0, MOST_EVENTS)
        if events > self._stream.pending.size:
            self._grow_queue(events)

    @property
    def parameters(self) -> list[Parameter]:
        """Live parameters of every part."""
        return [parameter for p, preset in enumerate(self.parts) for parameter in parameters_of(p, preset)]

    def _grow_queue(self, size: int) -> None:
        bigger = np.zeros(size, EVENT)
        bigger[: self._stream.pending.size] = self._stream.pending
        self._set_queue(bigger)

    def _set_queue(self, pending: np.ndarray) -> None:
        """Another array for the events that wait."""
        before, self._stream = self._stream, self._stream._replace(pending=np.ascontiguousarray(pending))
        fresh = self._core_table(self._prepared())
        self._core[: fresh.size] = fresh  # what stands behind its own parts stays
        del before  # until now the core's

    @property
    def mode_steps(self) -> int:
        """Work done since reset: modes × internal steps."""
        self._prepared()
        return int(self._sounding.tallies["mode_steps"].sum())

    def report(self) -> EngineReport:
        """What has happened since `reset`."""
        self._prepared()
        state = self._state
        counters = state.counters
        unplayed = []
        for p, note in np.argwhere(state.unplayed > 0):
            count = int(state.unplayed[p, note])
            if p == len(self.parts):
                unplayed.append(Unplayed(-1, int(note), count, "its channel has no preset"))
                continue
            unplayed.append(Unplayed(int(p), int(note), count, why_unplayed(self.parts[p], int(note))))
        limiter = self._chains.limiter(self._stream)
        return EngineReport(
            float(state.meters[layout.PEAK]),
            0.0 if limiter is None else largest_reduction_db(limiter),
            self.strings_sounding,
            int(counters[layout.MOST_AWAKE]),
            int(counters[layout.N_NOTES]),
            tuple(unplayed),
            int(counters[layout.N_STOLEN]),
            int(counters[layout.N_TAKEN]),
            int(counters[layout.N_DROPPED]),
            self.mode_steps,
            int(self._sounding.tallies["unsolved"].sum()),
            int(self._sounding.tallies["silenced"].sum() + state.part_state["silenced"].sum() + counters[layout.N_SILENCED]),
        )
