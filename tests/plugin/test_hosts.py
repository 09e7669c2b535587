"""Plugins in programs of others: the sound is the engine's there too. tools/plugin-hosts asks more of them."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from synth.instrument.preset import Preset
from synth.plugin import bundle
from synth.plugin.bankfile import bank
from synth.plugin.description import describe
from synth.plugin.platforms import TARGETS
from tests.engine.kit import NECK

from .hostruns import play, same, song_of
from .songs import truth

RATE_HZ, BLOCK, FRAMES = 44100, 256, 256 * 100
PRESET: Preset = NECK


@pytest.fixture(scope="module")
def folder(library_file: Path, tmp_path_factory) -> Path:
    """A VST3 and an LV2 plugin of a small preset."""
    made = tmp_path_factory.mktemp("hosts")
    plugins = bundle.Plugins(library_file, bank([PRESET], [RATE_HZ]), describe([PRESET]), TARGETS["linux-x86-64"])
    for kind in ("vst3", "lv2"):
        plugins.write(kind, made / f"{PRESET.name}.{kind}")
    return made


def run(host: str, plugin: str, folder: Path, env: dict[str, str], lags: range) -> None:
    song = song_of(PRESET, FRAMES, np.random.default_rng(3), True)
    out = str(folder / f"{host}.npy")
    messages = [(frame, list(data)) for frame, data in song.messages]
    job = {"plugin": plugin, "rate_hz": RATE_HZ, "block": BLOCK, "frames": FRAMES, "messages": messages, "out": out}
    _, failure = play(sys.executable, host, job, env)
    assert not failure
    verdict = same(np.load(out), truth([PRESET], RATE_HZ, song).astype(np.float32), lags)
    assert verdict.startswith("the same bits"), verdict


@pytest.mark.parametrize("kind", ["vst3", "lv2"])
def test_minihost_hears_the_engine(folder, kind):
    if importlib.util.find_spec("minihost") is None:
        pytest.skip("minihost is not installed")
    run("minihost", str(folder / f"{PRESET.name}.{kind}"), folder, dict(os.environ), range(0, -301, -1))
