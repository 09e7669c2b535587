"""docs/extending/excitation.md does what it says: in an engine, and by `synth render` of the preset that names it."""

import numpy as np
import pytest
import soundfile

from synth.instrument import excitations
from synth.instrument.excitations import Excitation, ExcitationTable, register
from synth.instrument.preset import PresetError, load_preset
from tests.extending.pages import install, run, song, type_commands, write_files

HEARD = """
import numpy as np
from synth import EVENT, Engine, load_preset
from synth.midi.events import BEND, NOTE_ON, make_events


def played(preset, block, threads, rows, frames=9000, **more):
    engine = Engine([preset], limiter=False, threads=threads, **more)
    engine.prepare(44100.0, 4096)
    out = np.zeros((frames, 2))
    for at in range(0, frames, block):
        end = min(frames, at + block)
        here = [(row[0] - at, *row[1:]) for row in rows if at <= row[0] < end]
        engine.process(make_events(here) if here else np.zeros(0, EVENT), out[at:end])
    return engine, out


hammered = load_preset("hammered.toml")
rows = [(0, NOTE_ON, 0, 50, 100), (700, BEND, 0, 2000), (1311, NOTE_ON, 0, 48, 60), (4000, NOTE_ON, 0, 50, 127)]
runs = [played(hammered, block, threads, rows)[1] for block, threads in ((4096, 1), (333, 2), (1, 1))]
assert np.isfinite(runs[0]).all() and np.array_equal(runs[0], runs[1]) and np.array_equal(runs[0], runs[2])

# struck harder it is louder, in proportion: nothing touches this string
loud, soft = (played(hammered, 512, 1, [(0, NOTE_ON, 0, 50, velocity)])[1] for velocity in (120, 60))
late = played(hammered, 50, 1, rows[:1], 50)[0].latency_samples + 400
assert np.abs(loud[late:] - 2.0 * soft[late:]).max() < 1e-9 * np.abs(loud).max()

# and it is not the pluck
plucked = played(hammered.model_copy(update={"excitation": None}), 512, 1, [(0, NOTE_ON, 0, 50, 120)])[1]
assert np.abs(plucked - loud).max() > 0.1 * np.abs(loud).max()
"""


def installed(folder):
    names = [path.name for path in write_files("excitation", folder)]
    assert names == ["strike.py", "pyproject.toml", "hammered.toml"]
    install(folder)


def test_the_page_runs(tmp_path):
    installed(tmp_path)
    song(tmp_path / "song.mid")
    type_commands("excitation", tmp_path)
    sound, _ = soundfile.read(tmp_path / "hammered.wav")
    assert 0.001 < np.abs(sound).max() <= 1.0


def test_it_does_what_it_says_in_an_engine(tmp_path):
    installed(tmp_path)
    (tmp_path / "program.py").write_text(HEARD)
    run(tmp_path, "python", "program.py")


class Stroke(ExcitationTable):
    """Nothing but the kind."""


def nothing(core: int, thread: int, s: int, more: int) -> None:
    """Does nothing."""


def test_what_cannot_be_registered():
    for name in ("Strike", "", "pluck"):
        with pytest.raises(ValueError, match="an excitation"):
            register(Excitation(name, Stroke, tuple, nothing, nothing))
    with pytest.raises(TypeError, match="settings of the excitation x must be an ExcitationTable's class"):
        register(Excitation("x", dict, tuple, nothing, nothing))  # type: ignore[arg-type]


def test_a_preset_with_an_excitation_that_is_not_there(tmp_path, monkeypatch):
    written = {path.name: path for path in write_files("excitation", tmp_path)}
    monkeypatch.setattr(excitations.EXCITATIONS, "known", {})
    with pytest.raises(PresetError, match=r"excitation.kind: an excitation named 'strike' is not known; known: pluck"):
        load_preset(str(written["hammered.toml"]))
    text = written["hammered.toml"].read_text()
    for wrong, said in (
        ('excitation = { kind = "pluk" }', r"excitation.kind: an excitation named 'pluk' is not known \(perhaps pluck\?\)"),
        ('excitation = { kind = "pluck", depth_mm = 1 }', r"excitation.depth_mm: no such key"),
        ("excitation = { depth_mm = 1 }", r"excitation.kind: missing"),
        ("excitation = 3", r"excitation: "),
    ):
        changed = text.replace('excitation = { kind = "strike", depth_mm = 1.5 }', wrong)
        (tmp_path / "wrong.toml").write_text(changed)
        with pytest.raises(PresetError, match=said):
            load_preset(str(tmp_path / "wrong.toml"))
    (tmp_path / "plain.toml").write_text(text.replace('kind = "strike", depth_mm = 1.5', 'kind = "pluck"'))
    assert load_preset(str(tmp_path / "plain.toml")).excitation is not None
