"""What one call of the tool does: the impostor test, ranges from recordings, or ours against them."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from synth.fit.recording import FitRefused
from synth.instrument.preset import list_presets, load_preset
from synth.units import midi_to_hz
from truth_of_sound import families, hand, impostor, judge, measure, page, playing, ranges, sources, verdict
from truth_of_sound.ours import Player, judged

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


def measure_families(roots: list[Path], only: list[str]) -> None:
    """Keep the features of recordings of the impostor test as numbers, of all sets or those named.

    Raises ValueError, OSError.
    """
    families.measure(roots, impostor.equalised, only)


def impostors(names: list[str], publish: bool) -> None:
    """The impostor test of families, or of presets by name or file; onto the page if `publish`.

    Raises ValueError, OSError.
    """
    every = families.families()
    chosen = {name: family for name, family in every.items() if not names or name in names}
    for name in [name for name in names if name not in every]:
        preset = load_preset(name)
        # a file of one's own is of the family that has its `family`, or one of the same name
        home = next((f for f in every.values() if preset.name in f.presets), None) or every.get(preset.family)
        if home is None:
            raise ValueError(f"{name}: no recordings of its family; those of {', '.join(every)} are known")
        chosen[home.name] = replace(home, presets=(*(chosen[home.name].presets if home.name in chosen else ()), name))
    for family in chosen.values():
        ours = {}
        for name in family.presets:
            player = Player(load_preset(name))
            ours[player.preset.name] = judged(player, family.notes)
        found = verdict.verdict(family, ours, *families.kept(family))
        said = [f"Says little: {family.weak}.\n"] if family.weak else []
        parts = (*said, verdict.auc_table(found), verdict.feature_table(found), verdict.distance_table(found))
        _show(f"impostor {family.name}", "\n".join(parts), publish)


def playing_tables(names: list[str], publish: bool) -> None:
    """How presets, by default all, answer the player; onto the page if `publish`. Raises ValueError, OSError."""
    presets = [load_preset(name) for name in names] or list_presets()
    _show("playing", playing.table([playing.answer(preset) for preset in presets]), publish)


def _show(name: str, text: str, publish: bool) -> None:
    print(f"{name}\n\n{text}")
    if publish:
        page.put(name, text)
