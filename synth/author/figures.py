"""Short figures that suit an instrument's family: what the page plays beside a note, the open strings and a scale.

A figure is a row of (beats, semitones above its key), each note held until the next.
"""

from __future__ import annotations

from collections.abc import Sequence

from synth.instrument.preset import Preset

Figure = tuple[tuple[float, int], ...]

#: a bass line of an octave, in eighths
BASS: Figure = tuple((0.5, step) for step in (0, 0, 12, 0, 10, 7, 0, 3, 0, 0, 12, 0, 7, 10, 12, 0))
#: slow, round the tonic, as an alap opens: Sa Re Ga, up to Pa, and back to Sa
ALAP: Figure = ((2.0, 0), (0.5, 2), (1.5, 4), (0.5, 2), (0.5, 4), (2.0, 7), (0.5, 4), (0.5, 2), (1.0, 4), (0.5, 2), (2.5, 0))
#: a run down and up the scale hirajoshi
HIRAJOSHI: Figure = ((1.0, 12), (0.5, 8), (0.5, 7), (1.0, 3), (0.5, 2), (0.5, 0), (0.5, 2), (0.5, 3), (1.0, 7), (2.0, 0))
#: a broken chord over two octaves, up and down
SWEEP: Figure = (*tuple((0.5, step) for step in (0, 4, 7, 12, 16, 19, 24, 19, 16, 12, 7, 4)), (2.0, 0))
#: two minor and major chords, broken as fingers do
PICKED: Figure = (*tuple((0.5, step) for step in (0, 7, 12, 15, 12, 7, -2, 5, 10, 14, 10, 5)), (2.0, 0))

#: figures of families; of the others the broken chord
OF_FAMILY: dict[str, Figure] = {"bass": BASS, "sitar": ALAP, "veena": ALAP, "harp": SWEEP}
#: a tag of zithers and lutes that play in hirajoshi
JAPANESE = "japanese"


def figure_of(preset: Preset) -> Figure:
    """The figure that suits a preset."""
    if JAPANESE in preset.tags:
        return HIRAJOSHI
    return OF_FAMILY.get(preset.family, PICKED)


def key_of(figure: Figure, note: int, there: Sequence[int]) -> int:
    """The key of a figure: the note, or one some octaves from it, from which most of the figure can be played."""
    known = set(there)
    keys = [key for key in range(note % 12, 128, 12)]
    return max(keys, key=lambda key: (sum(key + step in known for _, step in figure), -abs(key - note)))
