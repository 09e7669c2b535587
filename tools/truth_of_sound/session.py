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
from truth_of_sound import controls, families, hand, judge, measure, page, playing, ranges, sources
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
    families.measure(roots, controls.equalised, only)


def impostors(names: list[str], family: str | None, publish: bool) -> None:
    """The impostor test of families, or of presets by name or file as members of `family`; onto the page if `publish`.

    Raises ValueError, OSError, ImportError.
    """
    try:
        from truth_of_sound import verdict
    except ModuleNotFoundError as error:
        raise ImportError(f"the impostor test needs scikit-learn: pip install '.[truth]' ({error})") from error
    for chosen in _chosen(names, family):
        if publish:
            page.check(f"impostor {chosen.name}")
        ours = {}
        for name in chosen.presets:
            player = Player(load_preset(name))
            ours[player.preset.name] = judged(player, chosen.notes)
        found = verdict.verdict(chosen, ours, *families.kept(chosen))
        said = [f"Says little: {chosen.weak}.\n"] if chosen.weak else []
        parts = (*said, verdict.auc_table(found), verdict.feature_table(found), verdict.distance_table(found))
        _show(f"impostor {chosen.name}", "\n".join(parts), publish)


def _chosen(names: list[str], family: str | None) -> list[families.Family]:
    """The families named, or that hold the presets named, with these alone."""
    every = families.families()
    if family is not None and family not in every:
        raise ValueError(f"no family {family!r}; there are {', '.join(every)}")
    if not names:
        return list(every.values()) if family is None else [every[family]]
    chosen = {name: every[name] for name in names if name in every}
    for name in [name for name in names if name not in every]:
        preset = load_preset(name)
        home = family or next((f.name for f in every.values() if preset.name in f.presets), None)
        if home is None:
            raise ValueError(f"{name}: no family has it; say by --family what it is compared with: {', '.join(every)}")
        others = chosen[home].presets if home in chosen else ()
        chosen[home] = replace(every[home], presets=(*others, name))
    return list(chosen.values())


def playing_tables(names: list[str], publish: bool) -> None:
    """How presets, by default all, answer the player; onto the page if `publish`. Raises ValueError, OSError."""
    presets = [load_preset(name) for name in names] or list_presets()
    if publish:
        page.check("playing")
    _show("playing", playing.table([playing.answer(preset) for preset in presets]), publish)


def _show(name: str, text: str, publish: bool) -> None:
    print(f"{name}\n\n{text}")
    if publish:
        page.put(name, text)
