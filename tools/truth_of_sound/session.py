"""What one call of the tool does: ranges from recordings, or ours against them."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from synth.fit.recording import FitRefused
from synth.instrument.preset import load_preset
from synth.units import midi_to_hz
from truth_of_sound import hand, judge, measure, page, ranges, sources
from truth_of_sound.ours import Player

RANGES = Path(__file__).resolve().parents[2] / "tests" / "truth" / "ranges.toml"
_SOURCE = {
    "fashionbass": "sfzinstruments/karoryfer.fashionbass, CC0",
    "pbf": "chickenpickin/PBF, CC0",
    "flbass": "cleary/samples-flbass, CC0",
    "FluidR3": "FluidR3_GM.sf2 (Debian fluid-soundfont-gm), MIT",
}


def gather(recordings: Path, soundfont: Path | None) -> Iterator[sources.Recorded]:
    """All notes of both sources."""
    yield from sources.recordings(recordings)
    if soundfont is not None:
        yield from sources.font_samples(soundfont)


def write_ranges(recordings: Path, soundfont: Path | None, publish: bool) -> None:
    """Measure all basses, write the file, print what was admitted, onto the page too if `publish`. Raises ValueError."""
    measured, basses = [], []
    for each in gather(recordings, soundfont):
        if each.instrument != "bass":
            continue
        basses.append(each)
        low, high = ranges.BASS
        if each.kind != "ring" or not low <= each.note <= high:
            continue
        try:
            note = measure.cut(each.samples, each.rate_hz)
            found = measure.ring(note, float(midi_to_hz(each.note)))
            measured.append((each.group, found | measure.early(note, found["f0_hz"])))
        except FitRefused as error:
            print(f"left out: {each.name}: {error}", file=sys.stderr)
    counts = {
        group: (count, next(text for start, text in _SOURCE.items() if group.startswith(start)))
        for group, count in Counter(group for group, _ in measured).items()
    }
    of_bass = ranges.ranges(measured, ranges.CANDIDATES)
    ranges.write(RANGES, of_bass, counts, hand.of_recordings(basses))
    _show("ranges", judge.admission_table(of_bass), publish)


def compare(names: list[str], publish: bool) -> None:
    """Tables of our presets against the ranges, onto the page if `publish`. Raises ValueError, OSError."""
    of_bass, of_hand = ranges.read(RANGES)
    for name in names:
        player = Player(load_preset(name))
        found = judge.bass(player)
        of_hands = judge.hand_table(judge.hands(player, found), of_hand)
        _show(player.preset.name, f"{judge.table(found, of_bass)}\n{of_hands}", publish)


def _show(name: str, text: str, publish: bool) -> None:
    print(f"{name}\n\n{text}")
    if publish:
        page.put(name, text)
