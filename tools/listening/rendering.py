"""Pieces as files: rendered once, kept while nothing that they depend on changes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import soundfile

from listening import tunes
from listening.pieces import Piece
from synth.files.targets import write_text, write_whole
from synth.host.memory import render

ROOT = Path(__file__).resolve().parents[2]
RATE_HZ = 48000
#: heard behind the last note, at most, of it faded out at the end [s]
TAIL_S, FADE_S = 3.0, 0.8
#: left for what the coding adds to peaks
HEADROOM = 0.89
#: of what the sound of a preset depends on
SOURCES = ("physics", "solver", "dsp", "instrument", "engine", "midi")


def sources_hash() -> str:
    """Of the program's files that the sound can depend on, and of those here."""
    digest = hashlib.sha256()
    paths = [path for room in SOURCES for path in (ROOT / "synth" / room).rglob("*.py")]
    paths += [ROOT / "synth" / "author" / "phrases.py", Path(tunes.__file__), Path(__file__)]
    for path in sorted(paths):
        digest.update(path.relative_to(ROOT).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def key_of(piece: Piece, sources: str) -> str:
    """What a piece's file depends on, as a short word."""
    text = "\n".join(
        (piece.preset.model_dump_json(), piece.phrase, str(piece.velocity), piece.quality, str(piece.level), sources)
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def sound(piece: Piece) -> np.ndarray:
    """(frames, 2) of a piece at RATE_HZ, faded out at its end."""
    events = tunes.events(piece.preset, piece.phrase, piece.velocity, RATE_HZ)
    samples = render(events, piece.preset, rate_hz=RATE_HZ, quality=piece.quality, tail=TAIL_S).samples
    fade = min(len(samples), round(FADE_S * RATE_HZ))
    samples *= HEADROOM
    samples[len(samples) - fade :] *= np.linspace(1.0, 0.0, fade)[:, None] ** 2
    return samples


def levelled(samples: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Samples as loud as others (by their power), and not above full scale."""
    gain = np.sqrt(np.mean(like**2) / np.mean(samples**2))
    return samples * min(gain, 0.99 / np.abs(samples).max())


def write(path: Path, samples: np.ndarray) -> None:
    """As Ogg Opus, in pieces: some releases of libsndfile fail with long arrays."""

    def into(file: object) -> None:
        shape = {"samplerate": RATE_HZ, "channels": samples.shape[1], "format": "OGG", "subtype": "OPUS"}
        with soundfile.SoundFile(file, "w", **shape) as ogg:
            for begin in range(0, len(samples), RATE_HZ):
                ogg.write(samples[begin : begin + RATE_HZ])

    write_whole(path, into)


def write_all(pieces: Sequence[Piece], folder: Path, silent: bool, say: Callable[[str], None]) -> None:
    """Files of all pieces that are not there already, and sounds.json, which lists them; `silent`: the list alone, with the
    files that are there. Files of pieces that there are no more are taken away."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = sources_hash()
    listed: list[dict[str, str | None]] = []
    before: Path | None = None
    for number, piece in enumerate(pieces):
        path = folder / f"{piece.file}-{key_of(piece, sources)}.ogg"
        if not silent and not path.exists():
            say(f"{number + 1}/{len(pieces)} {piece.title}")
            samples = sound(piece)
            if piece.level and before is not None:
                samples = levelled(samples, soundfile.read(before)[0])
            if samples.shape[1] == 2 and np.array_equal(samples[:, 0], samples[:, 1]):
                samples = samples[:, :1]
            write(path, samples)
        before = path
        about = {"section": piece.section, "piece": piece.file, "title": piece.title, "about": piece.about}
        listed.append({**about, "file": path.name if path.exists() else None})
    write_text(folder / "sounds.json", json.dumps(listed, indent=1, ensure_ascii=False))
    if not silent:
        for path in folder.glob("*.ogg"):
            if path.name not in {entry["file"] for entry in listed}:
                path.unlink()
