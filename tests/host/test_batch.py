"""Many notes at once: each to the bit what it is alone, in order, whatever becomes of the others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import synth
from synth import Note, render_notes
from synth.host import batch
from synth.host.batch import share_out
from synth.host.parts import Part
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, make_events
from tests.patience import patience_s

ROOT = Path(__file__).resolve().parents[2]
RATE_HZ = 44100
SECONDS, OFF_S = 0.25, 0.15


def alone(preset: str | synth.Preset, note: Note, **settings: object) -> np.ndarray:
    """(frames, 2) of the note as a song."""
    rows = [(0, CONTROL, 0, number, value) for number, value in note.controllers]
    rows.append((0, NOTE_ON, 0, note.note, note.velocity))
    if note.off_s is not None:
        rows.append((round(note.off_s * RATE_HZ), NOTE_OFF, 0, note.note, 64))
    settings = {"limiter": False, "threads": 1, **settings}
    return synth.render(make_events(rows), preset, end_s=note.seconds, rate_hz=RATE_HZ, **settings).samples


alone_once = cache(alone)
#: uncoupled, with a hand and frets, with strings that share a bridge, over a board, with sympathetic strings
PRESETS = {"tanpura-light": (36, 48), "electric-guitar": (40, 64), "steel-guitar": (40, 57), "fretless-bass": (28, 41),
           "sitar": (48, 55)}  # fmt: skip


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_note_is_what_it_is_alone(preset: str, threads: int) -> None:
    """The second of two equal ones, too: no note leaves anything to the next."""
    notes = [Note(key, velocity, SECONDS, OFF_S) for key in PRESETS[preset] for velocity in (40, 110, 40)]
    found = list(render_notes(preset, notes, threads=threads, dtype="float64"))
    assert [each.note for each in found] == notes and [each.number for each in found] == list(range(len(notes)))
    for each in found:
        if preset == "sitar" and each.note.note == 48:
            assert each.error == "C3 is not played: no string is tuned to it"
        else:
            assert np.array_equal(each.samples, alone_once(preset, each.note))
            assert np.abs(each.samples).max() > 1e-4


def test_float32_is_the_same_rounded_and_settings_count() -> None:
    note = Note(48, 90, 0.1)
    (single,) = render_notes("tanpura-light", [note], quality="draft", seed=5, limiter=True)
    double = alone("tanpura-light", note, quality="draft", seed=5, limiter=True)
    assert single.samples.dtype == np.float32 and np.array_equal(single.samples, double.astype(np.float32))
    (other,) = render_notes("tanpura-light", [note])
    assert not np.array_equal(other.samples, single.samples)


def test_what_varies_is_as_large_and_as_seeded_as_in_a_song() -> None:
    note, sounds = Note(55, 90, 0.2), []
    for settings in ({"seed": 1}, {"seed": 2}, {"variation": 0.0}):
        (found,) = render_notes("koto", [note], dtype="float64", **settings)
        assert np.array_equal(found.samples, alone("koto", note, **settings))
        sounds.append(found.samples)
    assert not np.array_equal(sounds[0], sounds[1]) and not np.array_equal(sounds[0], sounds[2])


def test_presets_of_notes_articulations_and_controllers() -> None:
    palm, bass = "palm-mute", "fretted-bass"
    loaded = synth.load_preset("tanpura-light")
    notes = [
        Note(33, 90, SECONDS, preset=bass, articulation=palm),
        Note(33, 90, SECONDS, preset=bass),
        Note(36, 90, SECONDS, preset=loaded),
        Note(36, 90, SECONDS, controllers=((7, 40),)),
        Note(36, 90, SECONDS),
    ]
    found = list(render_notes("tanpura-light", notes, threads=2, dtype="float64"))
    assert [each.error for each in found] == [""] * 5
    muted = Part(0, bass, 0, articulations=(palm,)).played(synth.load_preset(bass))
    for each, preset in zip(found, (muted, bass, loaded, "tanpura-light", "tanpura-light"), strict=True):
        assert np.array_equal(each.samples, alone(preset, each.note))
    assert not np.array_equal(found[0].samples, found[1].samples)
    assert not np.array_equal(found[3].samples, found[4].samples)


BAD = {
    "note must be at most 127, got 128": Note(128),
    "velocity must be at least 1, got 0": Note(48, 0),
    "velocity must be a whole number, got 'loud'": Note(48, "loud"),
    "seconds must lie between 0.001 and 600 s, got 0": Note(48, 80, 0.0),
    "off_s must": Note(48, 80, 1.0, -1.0),
    "controller 7 must be at most 127, got 200": Note(48, controllers=((7, 200),)),
    "C-1 is not played: outside C2-C3": Note(0, 80, 0.1),
    "preset 'no-such-preset' is not one of": Note(48, preset="no-such-preset"),
    "tanpura-light has no articulation 'pizzicato'; its articulations: none": Note(48, articulation="pizzicato"),
}


@pytest.mark.parametrize("threads", [1, 2])
def test_a_note_that_cannot_be_rendered_says_why_and_the_others_sound(threads: int) -> None:
    good = Note(48, 80, 0.1)
    notes = [good]
    for bad in BAD.values():
        notes += [bad, good]
    found = list(render_notes("tanpura-light", notes, threads=threads))
    assert [each.number for each in found] == list(range(len(notes)))
    for each in found[::2]:
        assert not each.error and np.array_equal(each.samples, found[0].samples)
    for each, said in zip(found[1::2], BAD, strict=True):
        assert each.samples is None and said in each.error and "\n" not in each.error


def test_notes_that_cannot_be_prepared_together_are_prepared_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    real = batch._Making.engine

    def engine(self, preset, keys, going):
        if 43 in keys:
            raise synth.PresetError("G2 cannot be compiled")
        return real(self, preset, keys, going)

    monkeypatch.setattr(batch._Making, "engine", engine)
    found = list(render_notes("tanpura-light", [(36, 80, 0.1), (43, 80, 0.1), (48, 80, 0.1)], threads=1, dtype="float64"))
    assert [each.error for each in found] == ["", "G2 cannot be compiled", ""]
    assert np.array_equal(found[2].samples, alone("tanpura-light", found[2].note))


def test_what_is_no_fault_of_a_note_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    def engine(*_):
        raise SystemError("broken")

    monkeypatch.setattr(batch._Making, "engine", engine)
    with pytest.raises(SystemError, match="broken"):
        list(render_notes("tanpura-light", [(48, 80, 0.1)]))
    assert not own_threads()


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ({"threads": 0}, "threads must be a whole number from 1 on or 'auto', got 0"),
        ({"threads": True}, "threads must be"),
        ({"dtype": "int16"}, "dtype must be 'float32' or 'float64', got 'int16'"),
        ({"ahead_mib": 0.0}, "ahead_mib must be more than 0"),
        ({"quality": "best"}, "quality must be one of"),
        ({"rate_hz": 1}, "rate_hz must be at least"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"variation": 3.0}, "variation must lie between 0 and 2, got 3"),
    ],
)
def test_arguments_that_cannot_be_are_refused_at_once(named: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        render_notes("tanpura-light", [(48, 80)], **named)
    with pytest.raises(TypeError, match=r"notes\[1\] must be a Note, \(note, velocity\)"):
        render_notes("tanpura-light", [(48, 80), 48])


def test_nothing_asked_for_is_nothing() -> None:
    assert list(render_notes("tanpura-light", [])) == []
    (found,) = render_notes(None, [(48, 80)])
    assert found.error == "preset is missing: give one for the note, or one for all notes"


def own_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("notes ")]


def test_left_early_it_ends_its_threads() -> None:
    sounds = render_notes("tanpura-light", [(48, 80, 0.5)] * 50, threads=2)
    next(sounds)
    assert own_threads()
    sounds.close()
    assert not own_threads()


def test_what_waits_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of notes that nobody takes, only as many are rendered as there is room for, and one that is to be taken next."""
    begun: list[int] = []
    real = batch._Making.sound
    monkeypatch.setattr(
        batch._Making,
        "sound",
        lambda self, engine, job, going: (begun.append(job.number), real(self, engine, job, going))[1],
    )
    one_mib = 4 * 2 * 0.1 * RATE_HZ / 2**20
    sounds = render_notes(
        "tanpura-light", [(36 if n % 2 else 48, 80, 0.1) for n in range(40)], threads=2, ahead_mib=4.5 * one_mib
    )
    taken = 0
    for each in sounds:
        assert each.number == taken and not each.error
        taken += 1
        assert max(begun) <= taken + 6
    assert taken == 40 and sorted(begun) == list(range(40))


def test_a_key_stays_with_its_worker_unless_that_has_much_more_to_do() -> None:
    keys = [(0, 36), (0, 48), (0, 36), (0, 48), (0, 60)]
    assert share_out(keys, [3.0] * 5, 2) == [0, 1, 0, 1, 0]
    many = share_out([(0, 36)] * 40, [3.0] * 40, 2)
    assert many[:7] == [0] * 7 and abs(many.count(0) - many.count(1)) <= batch.COMPILED_S / 3.0
    assert share_out([(0, 36), (1, 36)], [1.0, 1.0], 2) == [0, 1]
    assert share_out([], [], 2) == []


INTERRUPTED = """
import sys
import synth
for each in synth.render_notes("tanpura-light", [(48, 80, 1.0)] * 100000, threads=2):
    print("sounds", flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent otherwise there")
def test_ctrl_c_ends_it() -> None:
    with subprocess.Popen([sys.executable, "-c", INTERRUPTED], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True) as process:  # fmt: skip
        assert process.stdout is not None and process.stdout.readline() == "sounds\n"
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=patience_s())[1]
    assert process.returncode in (-signal.SIGINT, 1) and said.rstrip().endswith("KeyboardInterrupt")
