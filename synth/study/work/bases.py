"""What a row of a study is run from: a case, a preset's note, or a function of the user's.

A base travels to workers as a dict of plain values, with the text of all that it is made of, so that they need none of the
study's files (but for arrays that a case names: these lie where all can read them).
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from synth.engine.engine_settings import SETTINGS
from synth.research.case import OVERRIDES, Case, CaseError, case_path, files_of, is_coupled, put, read_tables, validated
from synth.spelling import perhaps
from synth.study.work.taken import Taken

#: of a note; whatever else a row sets is a key of the preset
NOTE_KEYS = {
    "note": 48, "velocity": 100, "seconds": 3.0, "off_s": None, "articulation": "", "quality": "standard",
    "rate_hz": 44100, "seed": 0, "variation": 0.0,
}  # fmt: skip
#: modes = this: those below half the internal rate, at most as many as the case has
BELOW_HALF = "below-half"


def source_of(base: Mapping[str, Any], settings: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What a row is made of beside its numbers, as plain values. Raises ValueError or OSError where it cannot be read.

    folder: of the study; its own files are looked for there before the program's.
    """
    if "call" in base:
        return {"kind": "call", "call": base["call"]}
    kind = "case" if base.get("case") or "case" in settings else "preset"
    name = settings.get(kind, base.get(kind))
    if not isinstance(name, str):
        raise ValueError(f"{kind} must be a name or a file, got {name!r}")
    beside = folder / name
    return _source(kind, str(beside) if beside.is_file() else name)


@lru_cache(maxsize=4096)
def _source(kind: str, name: str) -> dict[str, Any]:
    if kind == "case":
        tables, home, _ = read_tables(name, {})
        files = files_of(name)[1:]
        for table, key in (("string", "measured"), ("initial", "")):
            inner = tables.get(table, {})
            inner = inner.get(key) if key and isinstance(inner, dict) else inner
            if isinstance(inner, dict) and isinstance(inner.get("file"), str):
                inner["file"] = str((home / inner["file"]).resolve())
        digest = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files if path.is_file()]
        plain = _read_again(name)
        return {"kind": kind, "name": str(case_path(name)), "tables": tables, "content": [plain, digest]}
    from synth.instrument.planfile import read_beside, text_of
    from synth.instrument.preset import preset_path, read_preset

    text, plan = read_preset(name), text_of(read_beside(preset_path(name)))
    return {"kind": kind, "name": name, "text": text, "plan": plan, "content": [text, plan]}


def _read_again(name: str) -> Any:
    """The tables as the file has them, names of files in it as they stand there: what the address is made from."""
    return read_tables(name, {})[0]


def content_of(source: Mapping[str, Any]) -> Any:
    """What of a source decides on numbers: not where it lies."""
    return source["call"] if source["kind"] == "call" else [source["kind"], source["content"]]


def check_settings(source: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Raises ValueError where a row's settings describe no run; nothing is computed."""
    if source["kind"] == "case":
        tables, overrides = _case(source, settings)
        if is_coupled(tables):
            from synth.research.coupled.coupled_case import CoupledCase

            validated(CoupledCase, tables, source["name"])
            return
        if overrides.get("quality") is None and "internal_rate_hz" not in tables.get("run", {}):
            raise CaseError("run.internal_rate_hz: missing; set it, or quality")
        validated(Case, tables, source["name"])
    elif source["kind"] == "preset":
        _preset(source, settings)


def check_run(source: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Raises ValueError where a row describes what no string, obstacle or note can be; no step is computed."""
    if source["kind"] == "case":
        _check_scene(source, settings)
    elif source["kind"] == "preset":
        _check_note(*_preset(source, settings))


def run(source: Mapping[str, Any], settings: Mapping[str, Any], ledger: bool) -> Taken:
    """Runs a case, or renders a note. Raises ValueError, and whatever the run does."""
    return (_run_case if source["kind"] == "case" else _run_note)(source, settings, ledger)


def function_of(name: str) -> Any:
    """The function "module:name". Raises ValueError."""
    module, colon, attribute = name.partition(":")
    if not colon or not module or not attribute:
        raise ValueError(f"must be MODULE:FUNCTION, got {name!r}")
    try:
        found = getattr(import_module(module), attribute)
    except ImportError as error:
        raise ValueError(f"{name}: {error}; is its folder in the study's path?") from None
    except AttributeError:
        raise ValueError(f"{name}: module {module} has no {attribute}") from None
    if not callable(found):
        raise ValueError(f"{name} is not a function")
    return found


# --- cases --------------------------------------------------------------------------------------------------


def _case(source: Mapping[str, Any], settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tables with the settings in their places, and what `simulate` takes beside them."""
    tables = json.loads(json.dumps(source["tables"]))
    overrides: dict[str, Any] = {}
    for key, value in settings.items():
        if key == "case":
            continue
        if key == "quality":
            overrides["quality"] = value
        elif value == BELOW_HALF and OVERRIDES.get(key, tuple(key.split("."))) == ("run", "modes"):
            overrides["below_half"] = True
        else:
            put(tables, [str(part) for part in OVERRIDES.get(key, key.split("."))], value, key)
    if overrides.pop("below_half", False):
        tables["run"]["modes"] = _modes_below_half(source, tables)
    return tables, overrides


def _modes_below_half(source: Mapping[str, Any], tables: dict[str, Any]) -> int:
    from synth.physics.modes import count_modes_below
    from synth.research.scene import string_of

    if is_coupled(tables):
        raise CaseError(f'modes = "{BELOW_HALF}" is for one string; give a number')
    case = validated(Case, {**tables, "run": {**tables["run"], "modes": 1}}, source["name"])
    most = source["tables"].get("run", {}).get("modes", 10_000)
    found = count_modes_below(string_of(case.string, Path(), "string"), case.run.internal_rate_hz / 2.0)
    return max(1, min(int(most), int(found)))


def _check_scene(source: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    from synth.research.scene import Scene

    tables, overrides = _case(source, settings)
    with np.errstate(all="ignore"):
        if is_coupled(tables):
            from synth.research.coupled.coupled_case import CoupledCase
            from synth.research.coupled.coupled_scene import CoupledScene

            CoupledScene(validated(CoupledCase, tables, source["name"]), Path())
            return
        if overrides.get("quality") is not None:  # which chooses rate and modes: what does not hang on them
            run = tables.setdefault("run", {})
            run["internal_rate_hz"] = run.get("output_rate_hz") or NOTE_KEYS["rate_hz"]
        Scene(validated(Case, tables, source["name"]), Path())


def _run_case(source: Mapping[str, Any], settings: Mapping[str, Any], ledger: bool) -> Taken:
    from synth.research.case import StringTable
    from synth.research.scene import string_of
    from synth.research.simulation import simulate

    tables, overrides = _case(source, settings)
    if ledger:
        tables["run"]["ledger"] = True
    wall, cpu = time.perf_counter(), time.thread_time()
    with np.errstate(all="ignore"):  # what is not finite the measures say
        result = simulate(tables, **overrides)
    compiling = float(result.summary.get("compile_s", 0.0))
    wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
    stepping = float(result.summary.get("compute_s", cpu))  # compiling kernels, and loading them, is no part of a run
    wall, cpu = (stepping, stepping) if compiling > 0.0 else (wall, min(cpu, stepping))
    about = result.metadata
    expected = None
    if not is_coupled(tables):
        given = {key: value for key, value in about["case"]["string"].items() if value is not None}
        given.pop("measured", None)
        expected = string_of(StringTable.model_validate(given), Path(), "string").fundamental_hz
    rate_hz = (len(result.t) - 1) / float(result.t[-1] - result.t[0]) if len(result.t) > 1 else about["internal_rate_hz"]
    exact = about.get("output_rate_hz") or rate_hz
    return Taken(dict(settings), result.u, float(exact), expected, max(0.0, cpu), max(0.0, wall), result)


# --- notes --------------------------------------------------------------------------------------------------


def _preset(source: Mapping[str, Any], settings: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The preset as the settings change it, and the settings of the note. Raises PresetError or ValueError."""
    from synth.instrument.preset import PresetError

    preset, note = _loaded(source["text"], source["plan"], source["name"]), dict(NOTE_KEYS)
    for key, value in settings.items():
        if key in NOTE_KEYS:
            note[key] = value
        elif key != "preset":
            if "." not in key:
                raise PresetError(f"no setting {key!r}{perhaps(key, NOTE_KEYS)}; a preset's are TABLE.KEY")
            preset = preset.with_setting(key, json.dumps(value, ensure_ascii=False))
    if isinstance(note["note"], str):
        from synth.units import note_to_midi

        note["note"] = note_to_midi(note["note"])
    return preset, note


def _check_note(preset: Any, given: Mapping[str, Any]) -> None:
    from synth.host.batch import Note, played_as, what_is_wrong
    from synth.instrument.preset import playable_notes
    from synth.units import midi_to_note

    note = Note(given["note"], given["velocity"], given["seconds"], given["off_s"], None, given["articulation"])
    SETTINGS["quality"].checked("quality", given["quality"])
    playing = played_as(preset, note.articulation, 0) if not (wrong := what_is_wrong(note)) else wrong
    if isinstance(playing, str):
        raise ValueError(playing)
    there = playable_notes(playing[1])
    if note.note not in there:
        raise ValueError(
            f"note: {preset.name} does not play {midi_to_note(note.note)}; it plays {midi_to_note(there[0])} to "
            f"{midi_to_note(there[-1])}"
        )


@lru_cache(maxsize=64)
def _loaded(text: str, plan: str, name: str) -> Any:
    from synth.instrument.planfile import parse
    from synth.instrument.preset import parse_preset

    preset = parse_preset(text, name)
    return preset.with_measured(parse(plan, name)) if plan else preset


def _run_note(source: Mapping[str, Any], settings: Mapping[str, Any], ledger: bool) -> Taken:
    from synth.host.batch import Note, render_notes
    from synth.units import midi_to_hz

    if ledger:
        raise ValueError("a note has no energy ledger; measures of energy are for cases")
    preset, given = _preset(source, settings)
    note = Note(given["note"], given["velocity"], given["seconds"], given["off_s"], None, given["articulation"])
    wall, cpu = time.perf_counter(), time.process_time()
    (sound,) = render_notes(
        preset, [note], rate_hz=given["rate_hz"], quality=given["quality"], seed=given["seed"],
        variation=float(given["variation"]), dtype="float64", threads=1,
    )  # fmt: skip
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    if sound.error:
        raise ValueError(sound.error)
    assert sound.samples is not None
    return Taken(dict(settings), sound.samples, float(sound.rate_hz), midi_to_hz(note.note, preset.tuning.a4_hz), cpu, wall)
