"""The effects of an engine, placed in chains: their constants, and where in the State each one's own is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from synth.dsp.body_effect import BODY
from synth.dsp.delay_effect import DELAY, Delaying
from synth.dsp.effect import Effect, check_state, compiled
from synth.dsp.limiter_effect import LIMITER, Limiting
from synth.engine.layout import PLACED, QUANTUM, RING, SPAN, Effects, Stream
from synth.instrument.effects import EffectTable, effect_of
from synth.instrument.preset import Preset
from synth.native.arrays import aligned, allocate, record, whole_lines
from synth.native.views import table

#: an effect of the mix may be so many frames late that stems are still there when the mix comes out
MOST_LATENCY = RING - (SPAN + 1) * QUANTUM


class Link(NamedTuple):
    """An effect of a chain and its settings."""

    effect: Effect
    settings: Any


@dataclass(frozen=True)
class Placed:
    """An effect made, and where its arrays begin among Stream.effect_numbers and .effect_counts."""

    effect: Effect
    made: Any
    at_rest: Any
    places: tuple[int, ...]

    def state(self, numbers: np.ndarray, counts: np.ndarray) -> Any:
        """Its own State: views of these."""
        views = []
        for rest, place in zip(self.at_rest, self.places, strict=True):
            source = numbers if rest.dtype.kind == "f" else counts
            views.append(source[place : place + rest.size].reshape(rest.shape))
        return type(self.at_rest)(*views)


class Chains:
    """The chains of an engine, those of its parts in order and that of the mix last.

    Raises ValueError for settings that cannot be, naming the effect.
    """

    def __init__(self, parts: Sequence[Preset], mix: Sequence[EffectTable], ceiling: float | None, rate_hz: float) -> None:
        """ceiling: of the limiter, None for none."""
        of_parts = [[(link, _make(link, rate_hz)) for link in _links(preset)] for preset in parts]
        late = [sum(link.effect.latency(made) for link, made in chain) for chain in of_parts]
        for chain, latency in zip(of_parts, late, strict=True):
            if latency < max(late):
                link = Link(DELAY, Delaying(max(late) - latency))
                chain.append((link, _make(link, rate_hz)))
        of_mix = [Link(effect_of(table.kind), table) for table in mix]
        if ceiling is not None:
            of_mix.append(Link(LIMITER, Limiting(ceiling)))
        last = [(link, _make(link, rate_hz)) for link in of_mix]
        self.mix_latency = sum(link.effect.latency(made) for link, made in last)
        if self.mix_latency > MOST_LATENCY:
            raise ValueError(
                f"the mix effects may add up to {MOST_LATENCY} frames of latency, got {self.mix_latency}; leave one out"
            )
        #: of all parts alike
        self.part_latency = max(late, default=0)
        self.placed: list[Placed] = []
        self._chains = np.zeros((len(of_parts) + 1, 2), np.int64)
        sizes = {"f": 0, "i": 0}
        of_part = (2 if preset.stereo else 1 for preset in parts)
        for row, (chain, channels) in enumerate([*zip(of_parts, of_part, strict=True), (last, 2)]):
            self._chains[row, 0] = len(self.placed)
            for link, made in chain:
                rest = link.effect.at_rest(made, channels)
                check_state(link.effect, rest)
                places = []
                for array in rest:
                    places.append(sizes[array.dtype.kind])
                    sizes[array.dtype.kind] += whole_lines(array.size)
                self.placed.append(Placed(link.effect, made, rest, tuple(places)))
            self._chains[row, 1] = len(self.placed)
        self._numbers, self._counts = aligned(sizes["f"]), aligned(sizes["i"], np.int64)
        for placed in self.placed:
            for view, rest in zip(placed.state(self._numbers, self._counts), placed.at_rest, strict=True):
                view[:] = rest

    def at_rest(self) -> dict[str, np.ndarray]:
        """Stream.effect_numbers and .effect_counts to begin with."""
        return {"effect_numbers": self._numbers, "effect_counts": self._counts}

    def bound(self, stream: Stream) -> tuple[Effects, list[np.ndarray]]:
        """What the core needs to run the chains on this Stream, and the tables that it points to."""
        compiled(LIMITER)  # even if there is none: what will be compiled is counted before (`jit.compiling`)
        tables, rows = [], []
        for placed in self.placed:
            tables.append(table(placed.made, placed.state(stream.effect_numbers, stream.effect_counts)))
            process, silent = compiled(placed.effect)
            number, end_number = _extent(placed, "f")
            count, end_count = _extent(placed, "i")
            rows.append(
                record(
                    PLACED,
                    table=tables[-1].ctypes.data,
                    process=process.address,
                    silent=silent.address,
                    number=number,
                    end_number=end_number,
                    count=count,
                    end_count=end_count,
                )
            )
        sizes = {
            "parts": len(self._chains) - 1,
            "placed": len(rows),
            "effect_numbers": self._numbers.size,
            "effect_counts": self._counts.size,
        }
        arrays = {"chains": self._chains, "numbers": self._numbers, "counts": self._counts}
        return allocate(Effects, sizes, placed=np.array(rows, PLACED), **arrays), tables

    def limiter(self, stream: Stream) -> Any:
        """The state of the limiter, None without one."""
        for placed in self.placed:
            if placed.effect is LIMITER:
                return placed.state(stream.effect_numbers, stream.effect_counts)
        return None


def _links(preset: Preset) -> list[Link]:
    """The chain of a part: its body, if that rings, and the effects that it names."""
    body = [Link(BODY, preset.body)] if preset.body.resonance else []
    return body + [Link(effect_of(table.kind), table) for table in preset.effect]


def _make(link: Link, rate_hz: float) -> Any:
    try:
        return link.effect.made(link.settings, rate_hz)
    except ValueError as error:
        raise ValueError(f"{link.effect.kind}: {error}") from None


def _extent(placed: Placed, kind: str) -> tuple[int, int]:
    """First and behind the last of an effect's numbers ("f") or counts ("i")."""
    ends = [
        (place, place + rest.size)
        for rest, place in zip(placed.at_rest, placed.places, strict=True)
        if rest.dtype.kind == kind
    ]
    return (ends[0][0], ends[-1][1]) if ends else (0, 0)
