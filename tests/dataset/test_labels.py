"""Labels belong to the motion that is heard: from them alone the motion is carried on, and the sound is it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from synth.dataset.filling import fill
from synth.dataset.labelstore import read_labels
from synth.dataset.packing import decode
from synth.dataset.setfolder import SetFolder
from synth.dataset.shardfile import read_member
from synth.dataset.verifying import verify
from synth.dsp.decimator import design
from synth.solver.laws import EXACT_HOLD, coefficients
from tests.dataset.kit import HEAD, rows, written

RATE_HZ = 44100
#: pole of the engine's high-pass at 8 Hz
POLE = np.exp(-2.0 * np.pi * 8.0 / RATE_HZ)
#: force on the bridge over a bridge that buzzes; displacement of a string that frets stop and strike
SCENES = {
    "harp": ('preset = "jawari-harp"\nnote = "C4"\nvelocity = 100\n', 44100.0),
    "guitar": ('preset = "jazz-guitar"\nnote = "E3"\nvelocity = 127\nset."body.resonance" = [[]]\n'
               'set."body.direct_db" = 0.0\nset."output.kind" = "displacement"\n'
               'set."obstacle.action_12th_mm" = 0.9\nset."polarisation.heard" = 0.0\n', None),
}  # fmt: skip
RECIPE = """\
bit_depth = 24
[level]
normalize_dbfs = -1.0
[labels]
contacts = true
forces = true
state_hz = 200000.0
dtype = "float64"
[[notes]]
hold_s = 0.25
release_s = 0.0
"""


@pytest.fixture(scope="module", params=SCENES)
def labelled(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict, dict, np.ndarray]:
    """(folder, row, labels, sound) of one note."""
    place = tmp_path_factory.mktemp(request.param)
    fill(written(place, RECIPE + SCENES[request.param][0], HEAD), place / "set")
    (row,) = rows(place / "set")
    assert not row["error"]
    labels = read_labels(place / "set" / row["labels"], row)
    pcm, _ = decode(read_member(place / "set" / row["shard"], row["offset"], row["size"]))
    return place / "set", row, labels, pcm[:, 0] / 2.0**31


def test_the_sound_is_what_the_labelled_motion_gives(labelled: tuple[Path, dict, dict, np.ndarray]) -> None:
    """From one state the modes fly by the exact coefficients of the labelled ω and σ under the labelled forces; every later
    state on the tape is met, and what the labelled weights hear of it, filtered, is the FLAC to within its rounding."""
    _, row, labels, sound = labelled
    rate_hz = row["label_rate_hz"]
    factor = round(rate_hz / RATE_HZ)
    modes, points = len(labels["mode_omega"]), len(labels["point_x_m"])
    q, v = (labels[name].reshape(-1, modes) for name in ("state_q", "state_v"))
    shape = labels["point_shape"].reshape(points, modes)
    coef = coefficients(EXACT_HOLD, labels["mode_omega"], labels["mode_sigma"], row["linear_density_kg_m"], 1.0 / rate_hz)
    steps = round(row["seconds"] * rate_hz)
    force = np.zeros((steps, points))
    force[labels["force_step"], labels["force_point"]] = labels["force_n"]
    free = np.flatnonzero(~np.isnan(labels["finger_m"]))[-1] + 2  # the finger has let go
    begin = labels["state_step"][free]
    assert begin < 0.1 * rate_hz and (force[begin:] > 0.0).any()
    state = {int(step): shot for shot, step in enumerate(labels["state_step"])}
    x, y = q[free].copy(), v[free].copy()
    heard = np.full(steps + 1, np.nan)
    worst = 0.0
    for step in range(begin, steps + 1):
        heard[step] = labels["mode_wq"] @ x + labels["mode_wv"] @ y
        if step in state:
            worst = max(worst, np.abs(x - q[state[step]]).max())
        if step < steps:
            push = force[step] @ shape
            x, y = coef[0] * x + coef[1] * y + coef[4] * push, coef[2] * x + coef[3] * y + coef[5] * push
    assert worst < 1e-9 * np.abs(q[free:]).max()
    taps = design(float(RATE_HZ), factor)
    middle = len(taps) // 2
    first = -(-(begin + middle) // factor)
    last = (steps - middle) // factor
    line = np.array([taps @ heard[n * factor - middle : n * factor + middle + 1] for n in range(first, last)])
    # the engine's high-pass y[n] = p y[n−1] + x[n] − x[n−1]; one gain for all
    rise = np.diff(line)
    out = sound[first + 1 : last] - POLE * sound[first : last - 1]
    gain = (rise @ out) / (rise @ rise)
    assert len(out) > 0.1 * RATE_HZ and np.abs(sound).max() == pytest.approx(10 ** (-1 / 20), rel=1e-5)
    assert np.abs(out - gain * rise).max() < 2.5 * 2.0**-24  # two roundings to 24 bits, half a step each, and the filter's


def test_contacts_are_those_of_the_forces(labelled: tuple[Path, dict, dict, np.ndarray]) -> None:
    _, row, labels, _ = labelled
    assert len(labels["contact_point"]) == row["contact_count"] > 0
    assert labels["contact_impulse_ns"].sum() == pytest.approx(labels["force_n"].sum() / row["label_rate_hz"])
    assert labels["contact_peak_n"].max() == pytest.approx(labels["force_n"].max())
    assert set(labels["contact_point"]) == set(labels["force_point"]) <= set(range(row["point_count"]))
    assert (np.diff(labels["contact_start_s"]) >= 0.0).all() and labels["contact_end_s"].max() <= row["seconds"] + 1e-12
    assert (labels["point_x_m"] > 0.0).all() and (labels["point_x_m"] < row["length_m"]).all()


def test_labels_are_made_again_to_the_bit(labelled: tuple[Path, dict, dict, np.ndarray]) -> None:
    folder = labelled[0]
    assert verify(SetFolder(folder), 1).faults == ()


def test_arrays_of_several_items_lie_behind_each_other(tmp_path: Path) -> None:
    text = """\
[labels]
contacts = true
state_hz = 500.0
[[notes]]
preset = ["jawari-harp", "tanpura-light"]
note = ["C3"]
velocity = [60, 110]
hold_s = 0.1
release_s = 0.05
"""
    fill(written(tmp_path, text), tmp_path / "set")
    index = rows(tmp_path / "set")
    assert len(index) == 4
    for row in index:
        labels = read_labels(tmp_path / "set" / row["labels"], row)
        assert "force_n" not in labels and row["force_count"] == 0
        assert labels["state_q"].dtype == np.float32 and row["state_count"] == pytest.approx(0.15 * 500.0, abs=1)
        assert row["state_values_count"] == row["state_count"] * row["mode_count"]
        assert labels["mode_omega"][0] / (2 * np.pi) == pytest.approx(row["f0_hz"], rel=0.02)
        times = labels["state_step"] / row["label_rate_hz"]
        assert np.abs(times - np.arange(len(times)) / 500.0).max() <= 9 / row["label_rate_hz"]
    assert {row["string"] for row in index}
    assert verify(SetFolder(tmp_path / "set"), 4).faults == ()
