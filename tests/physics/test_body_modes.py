import math

import numpy as np
import pytest

from synth.physics.body_modes import Body, BodyMode, BridgePlace


def test_one_mode_at_its_resonance_and_far_from_it():
    body = Body((BodyMode(100.0, 30.0, 0.5),))
    omega = 2 * math.pi * 100.0
    # at resonance Q/(mΩ); far above the mass alone, 1/(iωm); far below the spring alone, iω/(mΩ²)
    assert body.mobility(omega)[0, 0] == pytest.approx(30.0 / (0.5 * omega), rel=1e-14)
    assert body.mobility(1e4 * omega)[0, 0] == pytest.approx(1 / (1j * 1e4 * omega * 0.5), rel=1e-5)
    assert body.mobility(1e-4 * omega)[0, 0] == pytest.approx(1j * 1e-4 * omega / (0.5 * omega**2), rel=1e-5)
    # half the power where Q(x − 1/x) = 1
    x = 1 / 60 + math.sqrt(1 / 3600 + 1)
    assert abs(body.mobility(x * omega)[0, 0]) == pytest.approx(30.0 / (0.5 * omega) / math.sqrt(2), rel=1e-13)


def test_mobilities_add_up_are_symmetric_and_take_power():
    rng = np.random.default_rng(1)
    modes = [
        BodyMode(f, 5.0 + 50 * rng.random(), rng.random(), tuple(rng.normal(size=3))) for f in 50 + 900 * rng.random(20)
    ]
    omega = 2 * math.pi * np.geomspace(20, 20000, 300)
    whole = Body(tuple(modes)).mobility(omega)
    assert whole.shape == (300, 3, 3)
    assert np.allclose(whole, sum(Body((mode,)).mobility(omega) for mode in modes), rtol=1e-12, atol=0)
    assert np.allclose(whole, whole.transpose(0, 2, 1), rtol=1e-13, atol=0)
    power = np.linalg.eigvalsh(whole.real)
    assert power.min() > 0.0
    # sign and size of a shape say nothing by themselves
    same = [BodyMode(m.frequency_hz, m.q, 9 * m.mass_kg, tuple(-3 * c for c in m.shape)) for m in modes]
    assert np.allclose(Body(tuple(same)).mobility(omega), whole, rtol=1e-12, atol=0)


def test_a_place_on_the_bridge():
    assert np.allclose(BridgePlace(0.02).direction(3), [1, 0, 0.02])
    assert np.allclose(BridgePlace(0.02, 90.0).direction(3), [0, 1, 0], atol=1e-16)
    assert np.allclose(BridgePlace(0.02, 30.0).direction(2), [math.sqrt(3) / 2, 0.5])
    assert BridgePlace(0.02).direction(1) == [1.0]
    with pytest.raises(ValueError, match="offset_m must be finite, got nan m"):
        BridgePlace(math.nan)
    with pytest.raises(ValueError, match="angle_deg must be finite, got inf°"):
        BridgePlace(0.0, math.inf)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency_hz": 0.0}, "body mode frequency_hz must be a number > 0 Hz, got 0.0"),
        ({"q": -3.0}, "body mode q must be a number > 0, got -3.0"),
        ({"mass_kg": math.nan}, "body mode mass_kg must be a number > 0 kg, got nan"),
        ({"mass_kg": "heavy"}, "body mode mass_kg must be a number"),
        ({"shape": ()}, r"shape must have 1 to 3 components \(normal, lateral, rocking\), got 0"),
        ({"shape": (1, 2, 3, 4)}, "shape must have 1 to 3 components .*, got 4"),
        ({"shape": (0, 0)}, r"must be finite and move the bridge, got \[0.0, 0.0\]"),
        ({"shape": (1, math.inf)}, "must be finite and move the bridge"),
        ({"radiation": math.inf}, "radiation must be finite, got inf"),
        ({"pan": 1.5}, r"pan must be from -1 \(left\) to 1 \(right\), got 1.5"),
        ({"pan": math.nan}, "pan must be from"),
    ],
)
def test_what_is_no_mode_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        BodyMode(**{"frequency_hz": 100.0, "q": 30.0, "mass_kg": 0.5, **change})


def test_what_is_no_body_is_refused():
    with pytest.raises(ValueError, match="at least one mode"):
        Body(())
    with pytest.raises(ValueError, match="shape of body mode 2 must have 2 components as that of mode 1, got 1"):
        Body((BodyMode(100, 30, 1, (1, 0)), BodyMode(200, 30, 1)))
