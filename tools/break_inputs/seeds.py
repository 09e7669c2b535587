"""Whole inputs of every kind, small, from which broken ones are made."""

from __future__ import annotations

import io
import sys
import tempfile
from functools import cache
from pathlib import Path

import mido
import numpy as np
import soundfile

from synth import simulate

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.fit.strings import render, steel  # noqa: E402

SCALE = b"! five.scl\n!\nfive equal steps\n 5\n!\n 240.0\n 480.0\n 3/2\n 960.0\n 2/1\n"
KEYBOARD = b"! a.kbm\n5\n0\n127\n60\n69\n440.0\n5\n0\n1\nx\n3\n4\n"


def _saved(song: mido.MidiFile) -> bytes:
    buffer = io.BytesIO()
    song.save(file=buffer)
    return buffer.getvalue()


@cache
def songs() -> tuple[bytes, ...]:
    """A plain song; one with controllers, bends, pressure, RPN, SysEx and tempo changes; one of format 0."""
    plain = mido.MidiFile(type=1, ticks_per_beat=96)
    plain.tracks.append(
        mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=400_000), mido.MetaMessage("track_name", name="a")])
    )
    notes = mido.MidiTrack([mido.Message("program_change", program=104)])
    for note in (43, 48, 48, 36):
        notes += [mido.Message("note_on", note=note, velocity=80), mido.Message("note_off", note=note, time=60)]
    plain.tracks.append(notes)

    rich = mido.MidiFile(type=0, ticks_per_beat=480)
    track = mido.MidiTrack(
        [
            mido.MetaMessage("time_signature", numerator=3, denominator=4),
            mido.MetaMessage("set_tempo", tempo=500_000),
            *[
                mido.Message("control_change", control=c, value=v)
                for c, v in ((101, 0), (100, 0), (6, 12), (38, 0), (7, 90), (10, 30))
            ],
            mido.Message("sysex", data=(0x7F, 0x7F, 8, 2, 0, 1, 48, 48, 10, 20)),
            mido.Message("sysex", data=(0x7E, 0x7F, 8, 8, 3, 127, 127, *range(60, 72))),
        ]
    )
    for step in range(6):
        track += [
            mido.Message("note_on", note=48 - step, velocity=30 + 15 * step, time=20),
            mido.Message("pitchwheel", pitch=-8000 + 3000 * step, time=30),
            mido.Message("aftertouch", value=20 * step, time=5),
            mido.Message("polytouch", note=48 - step, value=20 * step),
            mido.Message("control_change", control=64, value=127 * (step % 2)),
            mido.MetaMessage("set_tempo", tempo=500_000 - 50_000 * step),
            mido.Message("note_on", note=48 - step, velocity=0, time=100),
        ]
    track.append(mido.Message("control_change", control=120, value=0))
    rich.tracks.append(track)
    frames = bytearray(_saved(plain))
    frames[12:14] = b"\xe7\x28"  # 25 frames a second, 40 ticks a frame
    return _saved(plain), _saved(rich), bytes(frames)


@cache
def presets() -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for path in sorted((ROOT / "presets").glob("*.toml")))


def scales() -> tuple[bytes, ...]:
    return (SCALE,)


def keyboards() -> tuple[bytes, ...]:
    return (KEYBOARD,)


@cache
def cases() -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for path in sorted((ROOT / "presets" / "cases").rglob("*.toml")))


@cache
def recordings() -> tuple[bytes, ...]:
    """Two seconds of a plucked string as WAV of 16 and 24 bits and of floats, and as FLAC."""
    sound = render(steel(110.0), np.random.default_rng(1))[: 2 * 44100]
    files = []
    for container, subtype in (("WAV", "PCM_16"), ("WAV", "PCM_24"), ("WAV", "FLOAT"), ("FLAC", "PCM_16")):
        buffer = io.BytesIO()
        soundfile.write(buffer, sound, 44100, format=container, subtype=subtype)
        files.append(buffer.getvalue())
    return tuple(files)


@cache
def results() -> tuple[bytes, ...]:
    """A run of the tanpura's case, as `synth simulate` writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.npz"
        simulate("tanpura", duration=0.01, rate=44100, modes=50).save(path)
        return (path.read_bytes(),)
