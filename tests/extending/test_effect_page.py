"""docs/extending/effect.md does what it says: in an engine, and by `synth render` of the preset that names the effect."""

import numpy as np
import soundfile

from tests.extending.pages import install, run, song, type_commands, write_files

HEARD = """
import sys
import numpy as np
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.midi.events import NOTE_ON, EVENT, make_events

engine = Engine([load_preset("dark.toml")], limiter=False)
engine.prepare(44100.0, 4096)
runs = []
for block in (4096, 333, 1):
    engine.reset()
    out = np.zeros((6000, 2))
    for at in range(0, 6000, block):
        rows = [(0, NOTE_ON, 0, 50, 100)] if at == 0 else []
        engine.process(make_events(rows) if rows else np.zeros(0, EVENT), out[at : at + block])
    runs.append(out)
assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[0], runs[2])
np.save(sys.argv[1], runs[0])
"""


def test_the_page_runs(tmp_path):
    names = [path.name for path in write_files("effect", tmp_path)]
    assert names == ["darken.py", "pyproject.toml", "dark.toml"]
    install(tmp_path)
    song(tmp_path / "song.mid")
    # the same without the effect
    bright = (tmp_path / "dark.toml").read_text().replace('effect = [{ kind = "darken", cutoff_hz = 800.0 }]\n', "")
    (tmp_path / "bright.toml").write_text(bright)
    type_commands("effect", tmp_path)
    run(tmp_path, "synth", "render", "song.mid", "--preset", "bright.toml", "--quiet", "-o", "bright.wav")
    dark, rate_hz = soundfile.read(tmp_path / "dark.wav")
    plain, _ = soundfile.read(tmp_path / "bright.wav")
    frames = min(len(dark), len(plain), rate_hz // 2)
    levels = [np.abs(np.fft.rfft(sound[:frames, 0])) for sound in (dark, plain)]
    hz = np.fft.rfftfreq(frames, 1.0 / rate_hz)
    share = 1.0 - np.exp(-2.0 * np.pi * 800.0 / rate_hz)
    for low, high in ((100.0, 200.0), (3000.0, 4000.0)):
        band = (hz > low) & (hz < high)
        z = np.exp(-2j * np.pi * hz[band] / rate_hz)
        gain = np.abs(share / (1.0 - (1.0 - share) * z))
        expected = np.sqrt(np.sum((gain * levels[1][band]) ** 2))
        assert abs(np.sqrt(np.sum(levels[0][band] ** 2)) / expected - 1.0) < 0.05


def test_any_block_size_gives_the_same_and_it_is_the_low_pass(tmp_path):
    write_files("effect", tmp_path)
    install(tmp_path)
    (tmp_path / "heard.py").write_text(HEARD)
    run(tmp_path, "python", "heard.py", "dark.npy")
    text = (tmp_path / "dark.toml").read_text()
    (tmp_path / "dark.toml").write_text(text.replace('effect = [{ kind = "darken", cutoff_hz = 800.0 }]\n', ""))
    run(tmp_path, "python", "heard.py", "bright.npy")
    dark, bright = (np.load(tmp_path / f"{name}.npy")[:, 0] for name in ("dark", "bright"))
    low, expected, share = 0.0, np.zeros_like(bright), -np.expm1(-2.0 * np.pi * 800.0 / 44100.0)
    for i, sample in enumerate(bright):
        low += share * (sample - low)
        expected[i] = low
    # the high-pass behind it is linear and begins with it, so that their order does not matter
    assert np.abs(dark).max() > 1e-3
    np.testing.assert_allclose(dark, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_a_preset_that_names_what_is_not_installed_says_so(tmp_path):
    write_files("effect", tmp_path)
    done = run(tmp_path, "python", "-c", WRONG)
    assert "effect.0.kind: an effect named 'darken' is not known" in done


WRONG = """
from synth.instrument.preset import PresetError, load_preset
try:
    load_preset("dark.toml")
except PresetError as error:
    print(error)
"""
