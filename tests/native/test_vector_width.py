"""How wide vectors are: the trial, what is made of it, and that it is made once."""

import json
import os
import subprocess
import sys

import pytest

from synth.jit import kernel_cache, prebuilt, vector_width
from synth.jit.vector_width import choose, described, kept, settle, use_kept
from synth.native import processors
from tests.patience import compiling_s

LENGTHS = ("16", "32", "64", "128", "256")


def times(*narrow: float) -> dict:
    """Times of half a register at each length, those of a whole one being 1."""
    return {"8": dict.fromkeys(LENGTHS, 1.0), "4": dict(zip(LENGTHS, narrow, strict=True))}


@pytest.fixture(autouse=True)
def open_to_choose(monkeypatch, tmp_path):
    """A processor with something to choose, whose user has not chosen, and an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("JAWARI_LANES", "JAWARI_TRIAL"):
        monkeypatch.setenv(name, "")  # so that it is put back to what it was, whatever a test does
        monkeypatch.delenv(name)
    monkeypatch.setattr(vector_width, "level", lambda: "x86-64-v4")
    monkeypatch.setattr(vector_width, "processor", lambda: "Processor X")
    assert prebuilt.found().path is None


@pytest.fixture
def trial(monkeypatch):
    """Makes a trial give what is asked for, and counts."""
    made = []

    def gives(seconds):
        def run(command, **more):
            made.append(command)
            if isinstance(seconds, Exception):
                raise seconds
            return subprocess.CompletedProcess(command, 0, json.dumps(seconds).encode(), b"")

        monkeypatch.setattr(vector_width.subprocess, "run", run)
        return made

    return gives


@pytest.mark.parametrize(
    ("narrow", "lanes"),
    [
        ((1.1, 1.4, 1.7, 1.8, 1.9), "8"),
        ((0.95, 1.0, 1.0, 1.0, 1.0), "8"),  # no better than timings are
        ((0.5, 0.8, 1.0, 1.5, 1.9), "8-32"),
        ((1.2, 0.8, 0.8, 1.5, 1.9), "8"),  # a blip in the middle
        ((0.5, 0.8, 0.8, 0.85, 0.9), "4"),
    ],
)
def test_half_a_register_is_taken_where_it_is_clearly_faster(narrow, lanes):
    assert choose(times(*narrow)) == lanes


def test_a_trial_is_made_once_and_kept(trial):
    made = trial(times(0.5, 0.8, 0.8, 1.5, 1.9))
    assert settle() == "8-64" and os.environ["JAWARI_LANES"] == "8-64"
    assert settle() is None and len(made) == 1 and kept()["lanes"] == "8-64"
    del os.environ["JAWARI_LANES"]  # the next process
    use_kept()
    assert os.environ["JAWARI_LANES"] == "8-64"
    assert described() == "vectors of 8 doubles, 4 up to 64 modes by a trial (half as wide takes 0.5 to 1.9 times as long)"


def test_another_processor_has_a_trial_of_its_own(trial, monkeypatch):
    made = trial(times(2, 2, 2, 2, 2))
    settle()
    monkeypatch.setattr(vector_width, "processor", lambda: "Processor Y")
    assert kept() is None and settle() == "8" and len(made) == 2
    monkeypatch.setattr(vector_width, "processor", lambda: "Processor X")
    assert kept() is not None


def test_a_trial_that_fails_leaves_the_registers_width_and_is_not_made_again(trial):
    made = trial(subprocess.CalledProcessError(1, "trial"))
    assert settle() == "8" and settle() is None and len(made) == 1
    use_kept()
    assert "JAWARI_LANES" not in os.environ and described() == ""


def test_a_trial_that_takes_too_long_is_made_another_time(trial):
    made = trial(subprocess.TimeoutExpired("trial", 1.0))
    assert settle() is None and settle() is None and len(made) == 2 and kept() is None


def test_a_native_library_goes_before_what_a_trial_found(trial, monkeypatch, tmp_path):
    trial(times(0.5, 0.8, 0.8, 1.5, 1.9))
    settle()
    del os.environ["JAWARI_LANES"]
    library = tmp_path / "libjawari.so"
    library.write_bytes(b"")
    monkeypatch.setenv("JAWARI_NATIVE", str(library))
    use_kept()
    assert "JAWARI_LANES" not in os.environ


def test_kernels_of_the_width_that_was_found_are_kept_in_a_folder_of_their_own(trial, monkeypatch):
    trial(times(0.5, 0.8, 0.8, 1.5, 1.9))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "as it was")
    monkeypatch.setattr(kernel_cache, "_chosen", ["as it was"])
    settle()
    kernel_cache.point_again()
    assert os.environ["NUMBA_CACHE_DIR"].endswith("-8-64")


@pytest.mark.parametrize(
    "content", ["", "[1]", "{", '{"Processor X": {"lanes": "9"}}', '{"Processor X": {"lanes": "8"}}', '{"Processor X": 3}']
)
def test_a_file_that_is_not_ours_is_as_none(trial, tmp_path, content):
    made = trial(times(2, 2, 2, 2, 2))
    file = tmp_path / "jawari" / "vectors.json"
    file.parent.mkdir()
    file.write_text(content)
    use_kept()
    assert kept() is None and "JAWARI_LANES" not in os.environ
    assert settle() == "8" and len(made) == 1 and kept()["lanes"] == "8"


@pytest.mark.parametrize(("name", "value"), [("JAWARI_LANES", "4"), ("JAWARI_TRIAL", "0")])
def test_whoever_has_chosen_is_not_asked(trial, monkeypatch, name, value):
    made = trial(times(2, 2, 2, 2, 2))
    monkeypatch.setenv(name, value)
    assert settle() is None and not made


def test_where_there_is_nothing_to_choose_nothing_is_tried(trial, monkeypatch):
    made = trial(times(2, 2, 2, 2, 2))
    monkeypatch.setattr(vector_width, "level", lambda: "x86-64-v3")
    assert settle() is None and not made


@pytest.mark.skipif(processors.level() != "x86-64-v4", reason="this processor has no registers of eight doubles")
def test_the_trial_times_every_length_at_both_widths():
    done = subprocess.run(
        [sys.executable, "-m", "synth.solver.width_trial"],
        env={**os.environ, "JAWARI_LANES": "8", "JAWARI_NATIVE": "0"},
        capture_output=True,
        text=True,
        timeout=compiling_s(),
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert set(found) == {"8", "4"}
    assert all(tuple(found[lanes]) == LENGTHS and all(0.0 < s < 1.0 for s in found[lanes].values()) for lanes in found)
    assert choose(found) in vector_width._CHOICES
