"""The strings of a drone and the hand that plays them, as `synth drone` and `synth export --drone` are told of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from synth.cli.common import number

if TYPE_CHECKING:
    from synth.instrument.preset import Preset


def add_strings(parser: Any) -> None:
    """Options of how the strings are tuned."""
    parser.add_argument(
        "--sa", metavar="NOTE|HZ", help="the middle strings' Sa: a note (C#, C#3) or hertz (default: the preset's, C3)"
    )
    parser.add_argument(
        "--first",
        default="Pa",
        metavar="SWARA",
        help="first string: Pa (default), Ma, Ni, komal-Ni, Nishad, …, a ratio (3/2), or none",
    )
    parser.add_argument(
        "--strings", type=number(int, 4, 5), default=4, metavar="4|5", help="5: one more after the first, see --second"
    )
    parser.add_argument("--second", metavar="SWARA", help="the fifth string's swara (default Ni)")
    parser.add_argument(
        "--cents", type=_numbers, default=(), metavar="C,…", help="fine-tune each string in cents: --cents=-2,0,2,0"
    )


def add_hand(parser: Any) -> None:
    """Options of how the cycle is played."""
    parser.add_argument(
        "--spacing", type=_numbers, default=(), metavar="G,…", help="relative gaps after each string (default 1,1,1,1.6)"
    )
    parser.add_argument(
        "--human", type=number(float, 0, 1), default=0.4, metavar="X", help="variation of the strokes, 0 to 1 (default 0.4)"
    )
    seeds = number(int, 0, 2**32 - 1)
    parser.add_argument("--seed", type=seeds, default=0, metavar="N", help="seed of the variation (default 0)")


def check_strings(options: argparse.Namespace) -> None:
    """Raises ValueError for options that contradict each other."""
    if options.second is not None and options.strings == 4:
        raise ValueError("--second is the fifth string's swara; add --strings 5")


def pitches(options: argparse.Namespace, preset: Preset) -> dict[str, Any]:
    """`sa_hz`, `first`, `second` and `cents` of `Pegs` of a preset. Raises ValueError naming the option."""
    from synth.drone.swara import frequency_of, ratio_of
    from synth.units import midi_to_note

    tables = preset.string
    home = tables[1 if len(tables) > 1 else 0].notes[0]  # what is no tanpura is refused by the pegs
    sa = midi_to_note(home) if options.sa is None else options.sa
    return {
        "sa_hz": read("sa", sa, lambda text: frequency_of(text, preset.tuning.a4_hz, home)),
        "first": None if options.first.strip().lower() == "none" else read("first", options.first, ratio_of),
        "second": read("second", options.second or "Ni", ratio_of) if options.strings == 5 else None,
        "cents": options.cents,
    }


def read(option: str, text: str, reader: Any) -> Any:
    """What a reader makes of an option's text. Raises ValueError naming the option."""
    try:
        return reader(text)
    except ValueError as error:
        raise ValueError(f"--{option}: {error}") from None


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers with commas between them, got {text!r}") from None
