"""Scenes into arrays, by what stays of the package: the public names of `synth`, and its command line.

This runs with the package of either side, so nothing else is imported from it.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import tempfile
from collections.abc import Sequence
from dataclasses import fields
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

import synth

Arrays = dict[str, np.ndarray]

#: kinds of events by the words for them in scenes; the numbers are part of the format of EVENT
KINDS = {
    "on": 1, "off": 2, "control": 3, "bend": 4, "program": 5, "parameter": 6, "pressure": 7, "key-pressure": 8, "tuning": 9,
}  # fmt: skip
#: what an engine's report says about playing
COUNTED = ("peak", "limiter_reduction_db", "strings_sounding", "most_strings", "notes", "stolen", "taken_over",
           "events_dropped", "unsolved_contacts", "silenced")  # fmt: skip


class Unknown(Exception):
    """The package has no such thing as the scene is about."""


def arrays_of(scene: dict[str, Any]) -> Arrays:
    """Everything that the scene gives, by name. Raises Unknown, and whatever the package raises."""
    return {"engine": _engine, "command": _command, "simulate": _simulate}[scene["kind"]](scene)


def _known(call: Any, *arguments: Any, **named: Any) -> Any:
    """A call; Unknown where it takes no such argument."""
    try:
        return call(*arguments, **named)
    except TypeError as error:
        if "unexpected keyword argument" in str(error):
            raise Unknown(str(error)) from None
        raise


# --- Engine


def _engine(scene: dict[str, Any]) -> Arrays:
    """`out` (frames, 2) of an engine that is given the scene's events in blocks, `stems`, and what its report counts."""
    engine, rate_hz = prepared(scene), scene.get("rate_hz", 44100)
    events = events_of(scene["events"], rate_hz, engine)
    frames = round(scene["seconds"] * rate_hz)
    out, stems = np.zeros((frames, 2)), np.zeros((len(engine.parts), frames, 2))
    at = 0
    for size in cycle(scene.get("blocks", [256])):
        if at == frames:
            break
        end = min(frames, at + size)
        now = events[(events["frame"] >= at) & (events["frame"] < end)].copy()
        now["frame"] -= at
        if scene.get("stems"):
            part = np.zeros((len(engine.parts), end - at, 2))
            engine.process(now, out[at:end], part)
            stems[:, at:end] = part
        else:
            engine.process(now, out[at:end])
        at = end
    report = engine.report()
    found = {"out": out}
    if scene.get("stems"):
        found |= {f"stem{p}": stem for p, stem in enumerate(stems)}
    found |= {f"report.{name}": np.array(getattr(report, name)) for name in COUNTED if hasattr(report, name)}
    found["report.unplayed"] = np.array([row[:3] for row in report.unplayed], np.int64).reshape(-1, 3)
    engine.close()
    return found


def prepared(scene: dict[str, Any]) -> Any:
    options = dict(scene.get("options", {}))
    if "only_notes" in options:
        options["only_notes"] = [None if notes is None else set(notes) for notes in options["only_notes"]]
    for name, values in scene.get("arrays", {}).items():
        options[name] = np.array(values)
    if "bindings" in options:
        options["bindings"] = {
            int(number): bound if isinstance(bound, str) else [tuple(row) for row in bound]
            for number, bound in options["bindings"].items()
        }
    engine = _known(synth.Engine, [_preset(each) for each in scene["presets"]], **options)
    engine.prepare(float(scene.get("rate_hz", 44100)), max(scene.get("blocks", [256])))
    if "spare" in scene:
        engine.spare = scene["spare"]
    return engine


def _preset(given: str | dict[str, Any]) -> Any:
    """A preset by name, or {preset or toml, set}; plan_of: the preset whose measured plan it has, where there are such."""
    if isinstance(given, str):
        given = {"preset": given}
    if "toml" in given:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "mine.toml"
            file.write_text(given["toml"], encoding="utf-8")
            preset = synth.load_preset(str(file))
    else:
        preset = synth.load_preset(_listed(given["preset"]))
    if "plan_of" in given and hasattr(preset, "with_measured"):
        preset = preset.with_measured(synth.load_preset(given["plan_of"]).measured)
    for key, value in given.get("set", {}).items():
        preset = preset.with_setting(key, value)
    return preset


def _listed(name: str) -> str:
    known = [each if isinstance(each, str) else each.name for each in synth.list_presets()]
    if name not in known:
        raise Unknown(f"no preset {name!r}")
    return name


def events_of(rows: Sequence[Sequence[Any]], rate_hz: float, engine: Any) -> np.ndarray:
    """EVENT array of rows (seconds, kind, channel or part, a, b, value); a parameter's `a` is its id."""
    indices = {parameter.id: parameter.index for parameter in engine.parameters}
    found = np.zeros(len(rows), synth.EVENT)
    for row, (seconds, kind, channel, a, b, value) in zip(found, rows, strict=True):
        if isinstance(a, str):
            if a not in indices:
                raise Unknown(f"no live parameter {a!r}")
            a = indices[a]
        row["frame"], row["kind"], row["channel"] = round(seconds * rate_hz), KINDS[kind], channel
        row["a"], row["b"], row["value"] = a, b, value
    return found[np.argsort(found["frame"], kind="stable")]


# --- the command line


def _command(scene: dict[str, Any]) -> Arrays:
    """What `synth …` writes, as samples of the file's own type: `out`, and every other file as `stem:NAME`.

    In the words of the command {folder} stands for a folder in which the scene's files and song.mid lie.
    """
    from synth.cli import main

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "out").mkdir()
        for file, text in scene.get("files", {}).items():
            (folder / file).write_text(text, encoding="utf-8")
        if "messages" in scene:
            _write_song(folder / "song.mid", scene)
        said, told = io.StringIO(), io.StringIO()
        words = [word.replace("{folder}", name) for word in scene["words"]]
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(told):
            try:
                code = main(words)
            except SystemExit as left:
                code = left.code if isinstance(left.code, int) else 1
        if code:
            line = next((line for line in said.getvalue().splitlines() if "error" in line), said.getvalue().strip())
            if "unrecognized arguments" in line or "invalid choice" in line:
                raise Unknown(line.replace(name, "…"))
            raise RuntimeError(f"exit code {code}: {line.replace(name, '…')}")
        found = {}
        for path in sorted(path for path in (folder / "out").rglob("*") if path.is_file()):
            found["out" if path.stem == "out" else f"stem:{path.stem}"] = _samples(path)
    return found


def _samples(path: Path) -> np.ndarray:
    kind = {"FLOAT": "float32", "DOUBLE": "float64", "PCM_16": "int16"}.get(soundfile.info(path).subtype, "int32")
    return soundfile.read(path, dtype=kind, always_2d=True)[0]


#: ticks of a beat, and the beat's duration that a song begins with [µs]
TICKS, BEAT_US = 960, 500_000


def _write_song(path: Path, scene: dict[str, Any]) -> None:
    """Messages (seconds at the first tempo, bytes) as a file; `tempi`: (seconds, µs a beat)."""
    from mido import Message, MetaMessage, MidiFile, MidiTrack

    rows = [(at, MetaMessage("set_tempo", tempo=tempo)) for at, tempo in scene.get("tempi", [])]
    rows += [(at, Message.from_bytes(data)) for at, data in scene["messages"]]
    track, now = MidiTrack(), 0
    for at, message in sorted(rows, key=lambda row: row[0]):
        tick = round(at * 1e6 / BEAT_US * TICKS)
        track.append(message.copy(time=tick - now))
        now = tick
    MidiFile(type=0, ticks_per_beat=TICKS, tracks=[track]).save(str(path))


# --- simulate


def _simulate(scene: dict[str, Any]) -> Arrays:
    """Arrays and numbers of every run's Result, as `RUN.NAME`; with `resume` each goes on from the one before."""
    found: Arrays = {}
    before = None
    for number, overrides in enumerate(scene["runs"]):
        named = dict(overrides)
        if scene.get("resume") and before is not None:
            if "resume_from" not in inspect.signature(synth.simulate).parameters:
                raise Unknown("simulate() goes on from no other run")
            named["resume_from"] = before
        result = before = _known(synth.simulate, scene["case"], warn=lambda _: None, **named)
        for field in fields(result):
            value = getattr(result, field.name)
            # what is kept to go on with is the scheme's own; metadata are words
            if field.name not in ("state", "metadata") and value is not None:
                found[f"{number}.{field.name}"] = np.asarray(value)
    return found
