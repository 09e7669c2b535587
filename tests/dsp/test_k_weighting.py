"""Loudness by ITU-R BS.1770 against pyloudnorm, and its coefficients against the standard's."""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.k_weighting import k_weighting, loudness_lufs


def test_coefficients_at_48_khz_are_the_standards() -> None:
    shelf, high = k_weighting(48000.0)
    assert shelf == pytest.approx(
        [1.53512485958697, -2.69169618940638, 1.19839281085285, 1.0, -1.69065929318241, 0.73248077421585], abs=1e-10
    )
    assert high == pytest.approx([1.0, -2.0, 1.0, 1.0, -1.99004745483398, 0.99007225036621], abs=1e-10)


def test_a_sine_of_997_hz_at_full_scale_on_one_channel_has_minus_3_lufs() -> None:
    t = np.arange(48000 * 3) / 48000.0
    sine = np.sin(2 * np.pi * 997.0 * t)[:, None]
    assert loudness_lufs(sine, 48000) == pytest.approx(-3.01, abs=0.01)
    assert loudness_lufs(np.hstack([sine, sine]), 48000) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("channels", [1, 2])
def test_against_pyloudnorm(channels: int) -> None:
    pyloudnorm = pytest.importorskip("pyloudnorm", reason="is in the extra `test`")
    rng = np.random.default_rng(1)
    # loud, soft and silent parts: both gates close
    level = np.repeat([1.0, 0.3, 0.01, 0.0, 0.5], 22050)[:, None]
    sound = 0.2 * level * rng.standard_normal((level.size, channels))
    meter = pyloudnorm.Meter(44100)
    assert loudness_lufs(sound, 44100) == pytest.approx(meter.integrated_loudness(sound), abs=0.1)


def test_what_is_short_is_one_block_and_silence_has_none() -> None:
    t = np.arange(4800) / 48000.0
    assert loudness_lufs(np.sin(2 * np.pi * 1000.0 * t)[:, None], 48000) == pytest.approx(-3.0, abs=0.3)
    assert loudness_lufs(np.zeros((48000, 2)), 48000) is None and loudness_lufs(np.zeros((0, 2)), 48000) is None
