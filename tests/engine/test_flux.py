"""The flux through a magnetic pickup: what a string's displacement becomes by it."""

from __future__ import annotations

import numpy as np

from synth.engine.output import NEAREST
from synth.instrument.preset import Preset
from synth.midi.events import NOTE_ON

from .kit import RATE_HZ, engine, play, preset, steel

#: gain of the outputs below [dB]
GAIN_DB = 50.0
#: shorter than any wave: then a pickup sees a point
POINT = "aperture_mm = 0.001"
#: of the magnet from the string at rest [m]
DISTANCE_M = 3e-3


def one(kind: str, *, at: float = 0.2, **pluck: float) -> Preset:
    """One string that touches nothing and is heard by a point."""
    output = f'kind = "{kind}"\nposition = {at}\ngain_db = {GAIN_DB}\ndistance_mm = {1e3 * DISTANCE_M}\n{POINT}'
    made = preset("one", steel("G2"), output=output)
    return made.model_copy(update={"pluck": made.pluck.model_copy(update=pluck)})


def heard(kind: str, velocity: int = 120, frames: int = 6000, **other: float) -> np.ndarray:
    """(frames,) what it gives."""
    made = engine(one(kind, **other), economy=False, precision="float64")
    return play(made, [(0, NOTE_ON, 0, 43, velocity)], frames)[:, 0]


def high_passed(x: np.ndarray, like: np.ndarray) -> float:
    """How far x is from `like`, in parts of it; both went through the same high-pass."""
    return float(np.abs(x - like).max() / np.abs(like).max())


def bent(metres: np.ndarray, distance_m: float) -> np.ndarray:
    """The flux by its law, of the unit of a displacement for small ones."""
    return 0.5 * distance_m * (1.0 - 1.0 / (1.0 + metres / distance_m) ** 2)


def undone(x: np.ndarray, pole: float) -> np.ndarray:
    """A signal before a high-pass y_i = x_i − x_{i−1} + pole·y_{i−1} that began at rest."""
    steps = x.copy()
    steps[1:] -= pole * x[:-1]
    return np.cumsum(steps)


def test_a_small_motion_is_its_displacement() -> None:
    small, same = (heard(kind, velocity=1) for kind in ("flux", "displacement"))
    assert 1e-5 < high_passed(small, same) < 1e-2


def test_a_wide_one_bends_by_the_law_of_the_magnet() -> None:
    wide, straight = heard("flux"), heard("displacement")
    pole, gain = float(engine(one("flux")).memory.settings.dc), 10.0 ** (GAIN_DB / 20.0)
    metres = undone(straight, pole) / gain
    assert np.abs(metres).max() > 5e-4
    assert metres.min() > -DISTANCE_M * (1.0 - NEAREST)
    expected = gain * bent(metres, DISTANCE_M)
    assert np.abs(undone(wide, pole) - expected).max() < 1e-3 * np.abs(expected).max()
    assert high_passed(wide, straight) > 0.1


def test_a_string_that_would_pass_the_magnet_stays_finite() -> None:
    out = heard("flux", 127, displacement_mm=19.0)
    assert np.isfinite(out).all()
    assert np.abs(out).max() > 0.0


def test_it_has_the_second_harmonic_of_a_string_that_has_none() -> None:
    """Heard and plucked in the middle a string has odd partials alone; bent, the even ones too."""

    def second(kind: str) -> float:
        x = heard(kind, 110, 22050, at=0.5, position=0.5)[4410:]
        level, hz = np.abs(np.fft.rfft(x * np.hanning(x.size), 1 << 17)), 440.0 * 2.0 ** ((43 - 69) / 12)
        at = [round(k * hz * (1 << 17) / RATE_HZ) for k in (1, 2)]
        one, two = (level[i - 40 : i + 40].max() for i in at)
        return float(two / one)

    assert second("displacement") < 1e-3 < 0.02 < second("flux")
