"""How a preset answers the player: brightness from soft to loud, strings beside each other, takes, ends of notes, sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyloudnorm
from numpy.typing import NDArray

from synth.dsp.measures import band_levels_db
from synth.engine.layout import VARIATION
from synth.instrument.preset import Preset, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON, PARAMETER
from synth.units import midi_to_note
from truth_of_sound.note_features import onset
from truth_of_sound.ours import RATE_HZ, Player
from truth_of_sound.page import marked

#: velocities of the brightness, eight apart
VELOCITIES = tuple(range(16, 128, 8))
#: aims: brightness may rise by so much from one to the next, and fall by so much (what rounding of a measure is) …
MOST_STEP, MOST_FALL = 1.30, 0.02
#: … and the loudness of notes may differ by so much [LU]: five recorded notes are 3 to 7 apart
MOST_SPREAD = 5.0
#: brightness and loudness are those of the first 0.3 s
EARLY_S = 0.3
#: between two strokes that are compared [s]
APART_S = 2.0
#: a note that is damped lasts so long, and is judged so long after its end [s]
HELD_S, AFTER_S = 0.5, 0.1
#: octave bands of the sum of both sides [Hz]; those weaker than this below the strongest do not count [dB]
_BANDS_HZ, _WEAK_DB = tuple(62.5 * 2.0**k for k in range(8)), 40.0
_METER = pyloudnorm.Meter(RATE_HZ, block_size=EARLY_S)


@dataclass(frozen=True)
class Answer:
    """Of one preset.

    brightness: {note: centroid at `VELOCITIES` [Hz]}
    loudness: {note: that at velocity 80, weighted as ITU-R BS.1770 does [LUFS]} of `five_notes`
    takes_db: how far two equal strokes are apart
    end_db: {note: level 100 ms after its end over that before}
    sides_db: how far left and right differ
    hole_db: what the weakest octave band of their sum loses
    """

    preset: Preset
    brightness: dict[int, NDArray[np.float64]]
    loudness: dict[int, float]
    takes_db: float
    end_db: dict[int, float]
    sides_db: float
    hole_db: float

    @property
    def steepest(self) -> float:
        """Largest ratio of the brightness of neighbouring velocities."""
        return max(float((c[1:] / c[:-1]).max()) for c in self.brightness.values())

    @property
    def darkest(self) -> float:
        """Largest part by which a louder stroke is darker than any softer one."""
        return max(float((1.0 - c / np.maximum.accumulate(c)).max()) for c in self.brightness.values())

    @property
    def spread(self) -> float:
        """Of the loudness of notes [LU]."""
        return float(np.ptp(list(self.loudness.values())))


def answer(preset: Preset) -> Answer:
    """Everything about one preset, at standard quality; strokes do not vary but where takes are compared."""
    player = _Player(preset)
    notes = five_notes(preset)
    brightness = {
        note: np.array([centroid_hz(player.stroke(note, velocity, EARLY_S).mean(axis=1)) for velocity in VELOCITIES])
        for note in (notes[0], notes[2])
    }
    middle = {note: player.stroke(note, 80, 1.0) for note in notes}
    left, right = np.concatenate(list(middle.values())).T
    apart = level_db(left - right) - level_db(left + right) if np.any(left != right) else -np.inf
    return Answer(
        preset,
        brightness,
        {note: loudness_lufs(x) for note, x in middle.items()},
        takes_apart_db(*player.takes(notes[2], 80)),
        {note: player.end_db(note) for note in dict.fromkeys(notes[1:4])},
        apart,
        hole_db(left, right),
    )


def five_notes(preset: Preset) -> list[int]:
    """Notes evenly over the lower four fifths of what a preset plays."""
    every = playable_notes(preset)
    return [every[round(share * (len(every) - 1))] for share in (0.0, 0.2, 0.4, 0.6, 0.8)]


def notes_apart(preset: Preset) -> float:
    """Range of the loudness of `five_notes` at velocity 80 [LU]."""
    player = _Player(preset)
    return float(np.ptp([loudness_lufs(player.stroke(note, 80, EARLY_S)) for note in five_notes(preset)]))


class _Player(Player):
    """Plays strokes that do not vary, but for `takes`."""

    def stroke(self, note: int, velocity: int, seconds: float) -> NDArray[np.float64]:
        return from_onset(self._varied([(1, NOTE_ON, 0, note, velocity)], seconds + 0.1), seconds)

    def takes(self, note: int, velocity: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        again, width = round(APART_S * RATE_HZ), round(EARLY_S * RATE_HZ)
        off = (again // 4, NOTE_OFF, 0, note, 0)
        strokes = [(1, NOTE_ON, 0, note, velocity), off, (again, NOTE_ON, 0, note, velocity)]
        out = self._varied(strokes, APART_S + EARLY_S + 0.05, 1.0).mean(axis=1)
        return out[:width], out[again : again + width]

    def end_db(self, note: int) -> float:
        end = round(HELD_S * RATE_HZ)
        out = self._varied([(1, NOTE_ON, 0, note, 100), (end, NOTE_OFF, 0, note, 0)], HELD_S + 0.3)
        width, after = round(0.03 * RATE_HZ), end + round(AFTER_S * RATE_HZ)
        return level_db(out[after : after + width]) - level_db(out[end - width : end])

    def _varied(self, events: list[tuple[int, ...]], seconds: float, share: float = 0.0) -> NDArray[np.float64]:
        return self.play([(0, PARAMETER, 0, VARIATION, 0, share), *events], seconds)


def from_onset(x: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """(frames, 2) from the onset of the louder side on. Raises ValueError for silence."""
    level = np.abs(x).max(axis=1)
    if not level.max() > 0.0:
        raise ValueError("a note of it is silent, where one is to be measured; play its notes with synth render")
    begin = onset(level)
    return x[begin : begin + round(seconds * RATE_HZ)]


def centroid_hz(x: NDArray[np.float64]) -> float:
    """Of the power spectrum."""
    power, hz = np.abs(np.fft.rfft(x * np.hanning(x.size), 1 << 15)) ** 2, np.fft.rfftfreq(1 << 15, 1.0 / RATE_HZ)
    return float((hz * power).sum() / max(power.sum(), 1e-30))


def level_db(x: NDArray[np.float64]) -> float:
    """Of the root mean square."""
    return float(10.0 * np.log10(np.mean(np.square(x)) + 1e-20))


def loudness_lufs(x: NDArray[np.float64]) -> float:
    """Of the first 0.3 s of samples (frames,) or (frames, sides), as ITU-R BS.1770 weights them."""
    return float(_METER.integrated_loudness(x[: round(EARLY_S * RATE_HZ)]))


def takes_apart_db(first: NDArray[np.float64], again: NDArray[np.float64]) -> float:
    """Median over third octaves with sound of how far their levels differ."""
    edges = 50.0 * 2.0 ** (np.arange(25) / 3.0)
    levels = np.array([band_levels_db(x, RATE_HZ, edges) for x in (first, again)])
    loud = levels.max(axis=0) > levels.max() - _WEAK_DB
    return float(np.median(np.abs(levels[0, loud] - levels[1, loud])))


def hole_db(left: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """The weakest octave band of (left + right)/2 beside the mean power of both sides there."""
    edges = np.array([*_BANDS_HZ, 2.0 * _BANDS_HZ[-1]])
    both = [band_levels_db(x, RATE_HZ, edges) for x in (left, right)]
    alone = band_levels_db(0.5 * (left + right), RATE_HZ, edges)
    power = 0.5 * (10.0 ** (both[0] / 10.0) + 10.0 ** (both[1] / 10.0))
    loud = power > power.max() * 10.0 ** (-_WEAK_DB / 10.0)
    return float((alone[loud] - 10.0 * np.log10(power[loud])).min())


def table(answers: list[Answer]) -> str:
    """One row per preset; what misses an aim is bold."""
    columns = (
        "preset", "brightness, soft to loud [Hz]", f"largest step (at most {MOST_STEP:g})", "largest fall (at most 2 %)",
        f"notes apart (at most {MOST_SPREAD:g}) [LU]",
        "takes apart [dB]", "100 ms after the note's end [dB]", "left − right over left + right [dB]",
        "weakest band of the mono sum [dB]",
    )  # fmt: skip
    lines = [f"| {' | '.join(columns)} |", f"| {' | '.join('---' for _ in columns)} |"]
    for each in answers:
        colours = "; ".join(f"{midi_to_note(note)} {c[0]:.0f} – {c[-1]:.0f}" for note, c in each.brightness.items())
        ends = ", ".join(f"{value:.0f}" for value in each.end_db.values())
        cells = (
            each.preset.name,
            colours,
            marked(f"{each.steepest:.2f}", each.steepest > MOST_STEP),
            marked(f"{100.0 * each.darkest:.1f} %", each.darkest > MOST_FALL),
            marked(f"{each.spread:.1f}", each.spread > MOST_SPREAD),
            f"{each.takes_db:.1f}",
            ends,
            marked("mono" if np.isinf(each.sides_db) else f"{each.sides_db:.0f}", bool(np.isinf(each.sides_db))),
            f"{each.hole_db:.1f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
