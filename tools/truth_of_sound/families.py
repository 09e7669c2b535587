"""Families of the impostor test (tests/truth/families.toml), and the features of their recordings (features.csv there)."""

from __future__ import annotations

import csv
import io
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from synth.files.targets import write_text
from synth.fit.recording import read_recording
from synth.units import note_to_midi
from truth_of_sound.note_features import FEATURES, FLOORS, Samples, features

FOLDER = Path(__file__).resolve().parents[2] / "tests" / "truth"
FAMILIES, KEPT = FOLDER / "families.toml", FOLDER / "features.csv"
#: what is added to the name of a set behind an equaliser, a control
EQUALISED = "equalised"
#: what is added to the name of a set's halves, where it is the only one of its family
TUNING, JUDGING = " (tuning)", " (judging)"
#: a set of fewer notes within a family's compass does not count
LEAST_NOTES = 4
#: words of files that are no note that begins and rings
_NO_NOTE = ("release", "slide", "noise", "off", "mute", "ghost", "harmonic")
#: of a recording that is read [s]
_MOST_S = 7

Notes = list[dict[str, float]]


@dataclass(frozen=True)
class Family:
    """What is compared with what; see families.toml. tuning, judging: names of sets; weak: why its figures say little."""

    name: str
    title: str
    low: int
    high: int
    notes: tuple[int, ...]
    presets: tuple[str, ...]
    tuning: tuple[str, ...]
    judging: tuple[str, ...]
    weak: str = ""

    @property
    def sets(self) -> tuple[str, ...]:
        """All sets, those that may be tuned on first."""
        return (*self.tuning, *self.judging)


def families(path: Path = FAMILIES) -> dict[str, Family]:
    """All of them by name. Raises ValueError, OSError."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    data.pop("sources", None)
    return {
        name: Family(name, **{key: tuple(value) if isinstance(value, list) else value for key, value in table.items()})
        for name, table in data.items()
    }


def sources(path: Path = FAMILIES) -> dict[str, str]:
    """{set: where it comes from, and its licence}. Raises ValueError, OSError."""
    return tomllib.loads(path.read_text(encoding="utf-8"))["sources"]


def _folder(name: str) -> str:
    """The folder of a set, or of half a set."""
    return name.removesuffix(TUNING).removesuffix(JUDGING)


def recorded(
    folder: Path, change: Callable[[Samples, int], Samples] | None = None
) -> Iterator[tuple[str, int, dict[str, float]]]:
    """(file, note, features) of a folder's notes; `change` goes ahead. Tells standard error what it leaves out."""
    for path in sorted(folder.iterdir()):
        note = note_of(path.name)
        if note is None or not rings(path):
            continue
        try:
            samples, rate_hz = read_recording(str(path))
            x = samples[: _MOST_S * rate_hz].mean(axis=1)
            yield path.stem, note, features(x if change is None else change(x, rate_hz), rate_hz, note)
        except (ValueError, OSError) as error:
            print(f"left out: {folder.name}/{path.name}: {error}", file=sys.stderr)


def folder_of(name: str, roots: list[Path]) -> Path:
    """The folder of a set under one of these. Raises ValueError where it is in none."""
    for root in roots:
        if (root / name).is_dir():
            return root / name
    raise ValueError(f"no folder {name} in {', '.join(map(str, roots))}; give the folder that holds it by --recordings")


def rings(path: Path) -> bool:
    """Whether a file is the recording of a note that begins and rings."""
    return path.suffix.lower() in (".flac", ".wav") and not any(word in path.stem.lower() for word in _NO_NOTE)


def note_of(file: str) -> int | None:
    """The note that a file's name begins with (E1, g#2, Eb3 before _ or .), None where it does not."""
    found = re.match(r"([A-Ga-g][#b]?-?\d)(?=[_.])", file)
    return None if found is None else note_to_midi(found[1][0].upper() + found[1][1:])


def measure(roots: list[Path], change: Callable[[Samples, int], Samples], only: Sequence[str] = ()) -> None:
    """Write features.csv anew from folders that hold a folder per set, or the sets named in it.

    Of the first set of each family also those behind an equaliser. Raises ValueError where a set is missing.
    """
    every = families()
    wanted = list(dict.fromkeys(_folder(name) for family in every.values() for name in family.sets))
    if unknown := sorted(set(only) - set(wanted)):
        raise ValueError(f"no family has a set {', '.join(unknown)}; known: {', '.join(wanted)}")
    first = {_folder(family.sets[0]) for family in every.values()}
    lines = _lines() if only else {}
    for name in only or wanted:
        folder = folder_of(name, roots)
        lines[name] = [_line(name, *found) for found in recorded(folder)]
        if name in first:
            lines[name] += [_line(f"{name} {EQUALISED}", *found) for found in recorded(folder, change)]
        print(f"{name}: {len(lines[name])} notes", flush=True)
    rows = [line for name in wanted for line in lines.get(name, ())]
    write_text(KEPT, "\n".join([",".join(("set", "file", "note", *FEATURES)), *rows]) + "\n")


def _line(name: str, file: str, note: int, found: dict[str, float]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow((name, file, note, *(f"{found[key]:.5g}" for key in FEATURES)))
    return text.getvalue()


def _lines() -> dict[str, list[str]]:
    """{set: its lines in features.csv}."""
    out: dict[str, list[str]] = {}
    for line in KEPT.read_text(encoding="utf-8").splitlines()[1:]:
        out.setdefault(line.split(",")[0].removesuffix(f" {EQUALISED}"), []).append(line)
    return out


def kept(family: Family, path: Path = KEPT) -> tuple[dict[str, Notes], dict[str, Notes]]:
    """({set: its notes within the family's compass}, {set: the same behind an equaliser}). Raises OSError."""
    found: dict[str, Notes] = {}
    turned: dict[str, Notes] = {}
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    counts: Counter[str] = Counter()
    for line in lines:
        name = line["set"].removesuffix(f" {EQUALISED}")
        to = turned if name != line["set"] else found
        if name not in family.sets:
            name += (TUNING, JUDGING)[counts[line["set"]] % 2]
            counts[line["set"]] += 1
        if name in family.sets and family.low <= int(line["note"]) <= family.high:
            to.setdefault(name, []).append({key: float(line[key]) for key in FEATURES})
    enough = {name: found[name] for name in family.sets if len(found.get(name, ())) >= LEAST_NOTES}
    return enough, {name: turned[name] for name in enough if name in turned}


def logged(notes: Notes, names: list[str] | None = None) -> np.ndarray:
    """(notes, features) as they are compared: logarithms where `FEATURES` says so, nan where a note does not tell."""
    keys = list(FEATURES) if names is None else names
    table = np.array([[note[key] for key in keys] for note in notes], float)
    for column, key in enumerate(keys):
        if FEATURES[key][1]:
            table[:, column] = np.log(np.maximum(table[:, column], FLOORS.get(key, 1e-3)))
    return table
