"""What is to be heard on the site's page of sounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from synth.instrument.catalogue import by_family
from synth.instrument.preset import Preset, list_presets, load_preset


@dataclass(frozen=True)
class Piece:
    """file: its name, without ending. preset, phrase (`tunes.events`), velocity, quality: what is rendered. level: made as
    loud as the piece before it."""

    section: str
    title: str
    about: str
    file: str
    preset: Preset
    phrase: str = "tune"
    velocity: int = 80
    quality: str = "standard"
    level: bool = False


def pieces() -> list[Piece]:
    """All, in the order of the page."""
    return [*_first(), *_jiva(), *_coupling(), *_velocity(), *_quality(), *_instruments()]


def _first() -> Iterator[Piece]:
    for name, title in (("tanpura", "Tanpura"), ("slap-bass", "Slap bass"), ("sitar", "Sitar")):
        yield Piece("first", title, "", name, load_preset(name))


#: height of the thread [µm], and what the player calls it
JIVA = (
    (60, "none: the string never reaches the bridge"),
    (20, "hardly any: strokes of medium strength stay clear"),
    (10, "some"),
    (3, "full, the preset's own: rings longest"),
    (0, "the most: the string rests on the bridge"),
)


def _jiva() -> Iterator[Piece]:
    tanpura = load_preset("tanpura-light")
    for height, about in JIVA:
        changed = tanpura.with_setting("obstacle.jiva_um", str(height))
        yield Piece("jiva", f"{height} µm", about, f"jiva-{height}", changed, "drone")


def _coupling() -> Iterator[Piece]:
    for name, title in (("tanpura-male", "Tanpura"), ("steel-guitar", "Steel-string guitar"), ("sitar", "Sitar")):
        preset = load_preset(name)
        yield Piece("coupling", f"{title}, with", "one bridge and body for all strings", f"{name}-with", preset)
        apart = preset.on_rigid_ends
        yield Piece("coupling", f"{title}, without", "each string by itself, at rest at both ends", f"{name}-without", apart,
                    level=True)  # fmt: skip


def _velocity() -> Iterator[Piece]:
    for name, title in (("fretted-bass", "Fretted bass"), ("jawari-harp", "Jawari harp")):
        for velocity in (40, 80, 120):
            yield Piece(
                "velocity", f"{title}, velocity {velocity}", "", f"{name}-{velocity}", load_preset(name), "tune", velocity
            )


def _quality() -> Iterator[Piece]:
    for name, title, phrase in (("tanpura", "Tanpura", "drone"), ("fretted-bass", "Fretted bass", "riff")):
        for quality in ("draft", "standard", "fine", "reference"):
            yield Piece("quality", f"{title}, {quality}", "", f"{name}-{quality}", load_preset(name), phrase, 100, quality)


def _instruments() -> Iterator[Piece]:
    for _, presets in by_family(list_presets()):
        for preset in presets:
            yield Piece("instruments", preset.title or preset.name, preset.description, preset.name, preset)
