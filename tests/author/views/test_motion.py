"""Slow motion: what is seen is what sounds, and the contacts are where and when the engine has them."""

import json

import numpy as np
import pytest

from synth.author.views import motion
from synth.author.views.analysis import analyse
from synth.author.views.instrument import draw
from synth.author.views.motion import MOST_FRAMES, film
from synth.engine.engine import Engine
from synth.host.string_tape import RATE_HZ, Taped
from synth.instrument.compile import compile_preset
from synth.instrument.place import find, speaking
from synth.instrument.preset import Preset, PresetError, load_preset
from synth.midi.events import NOTE_ON, make_events
from synth.solver.block_rows import BLOCK

from .kit import preset, tanpura

#: preset, note, velocity; touching from seldom to all the time, one point and many, under the finger and not
NOTES = [
    ("tanpura-light", 36, 100),
    ("tanpura-light", 48, 64),
    ("fretted-bass", 28, 120),
    ("fretted-bass", 40, 127),
    ("jawari-harp", 60, 90),
    ("jawari-harp", 96, 120),
    ("points", 50, 127),
    ("free", 48, 100),
]


def engine_alone(name: str, note: int, velocity: int, seconds: float, *, economy: bool) -> np.ndarray:
    """(frames,) the note by an engine without a tape."""
    engine = Engine([find(preset(name), note).preset], limiter=False, economy=economy, precision="float64")
    engine.prepare(RATE_HZ)
    out = np.zeros((round(seconds * RATE_HZ) + engine.latency_samples, 2))
    engine.process(make_events([(0, NOTE_ON, 0, note, velocity)]), out)
    return out[:, 0]


@pytest.mark.parametrize(("name", "note", "velocity"), NOTES)
def test_a_taped_engine_sounds_as_the_engine(name: str, note: int, velocity: int) -> None:
    taped = Taped(find(preset(name), note), precision="float64")
    out = np.concatenate([piece.out.copy() for piece in taped.play(velocity, 0.5)])
    alone = engine_alone(name, note, velocity, 0.5, economy=False)
    # where the finger is, is rounded otherwise, and contacts magnify it: to less than a 60th of what 24 bits resolve
    assert np.abs(out - alone).max() < 1e-9 * np.abs(alone).max()
    playing = engine_alone(name, note, velocity, 0.5, economy=True)
    assert np.abs(out - playing).max() < 10 ** (-90 / 20) * np.abs(playing).max()  # free flight at the output rate


def at_one_tension(name: str) -> Preset:
    """The preset with strings that keep the tension for which their coefficients were made."""
    data = preset(name).model_dump(exclude_unset=True)
    of_tension = ("tension_modulation", "axial_stiffness_n")
    strings = [{key: value for key, value in string.items() if key not in of_tension} for string in data["string"]]
    return Preset.model_validate(data | {"string": strings})


@pytest.mark.parametrize(("name", "note", "velocity"), [note for note in NOTES if note[0] != "free"])
def test_the_forces_on_the_tape_move_the_modes_on_the_tape(name: str, note: int, velocity: int) -> None:
    """x₊ = A x + g for (q, q̇) over a block, A = Φ⁸: q₊ = tr A · q − det A · q₋ + [g + (A − tr A) g₋]_q."""
    taped = Taped(find(at_one_tension(name), note), precision="float64")
    position = taped.position
    p11, p12, p21, p22, kq, kv = position.coef[:6]
    step = np.moveaxis(np.array([[p11, p12], [p21, p22]]), 2, 0)
    block = np.linalg.matrix_power(step, BLOCK)
    trace, det = np.trace(block, axis1=1, axis2=2), np.linalg.det(block)
    tested = 0
    for piece in taped.play(velocity, 0.15):
        inner = slice(np.count_nonzero(~np.isnan(piece.finger)) + 40, None)  # no finger and whole blocks
        q, ends = piece.q[inner], piece.ends[inner] - piece.first
        if len(q) < 100:
            continue
        assert set(np.diff(ends)) == {BLOCK}
        pushed = np.zeros((len(q), position.omega.size, 2))
        for late in range(BLOCK):
            kick = np.linalg.matrix_power(step, late) @ np.stack([kq, kv], 1)[:, :, None]
            pushed += (piece.force[ends - 1 - late] @ position.shapes)[:, :, None] * kick[None, :, :, 0]
        carried = (block - trace[:, None, None] * np.eye(2)) @ pushed[1:-1, :, :, None]
        expected = trace * q[1:-1] - det * q[:-2] + pushed[2:, :, 0] + carried[:, :, 0, 0]
        # where φ f is largest, and with it what an error in the forces would do
        assert np.abs(q[2:] - expected).max() < 1e-9 * np.abs(q).max()
        tested += int(piece.force.any())
    assert tested >= 1


@pytest.mark.parametrize(("name", "note", "velocity"), [("fretted-bass", 40, 127), ("tanpura-light", 48, 90)])
def test_a_frame_has_the_forces_and_the_sound_of_its_time(name: str, note: int, velocity: int) -> None:
    shown = film(preset(name), note, velocity, 0.02, 80, start_s=0.01)
    taped = Taped(find(preset(name), note))
    pieces = [(piece.force.copy(), piece.out.copy()) for piece in taped.play(velocity, 0.05)]
    force = np.concatenate([piece[0] for piece in pieces])
    out = np.concatenate([piece[1] for piece in pieces])[taped.latency_samples :]
    stride, first = round(shown["dt_s"] / taped.step_s), round(shown["start_s"] / taped.step_s)
    for k in range(80):
        until = first + k * stride
        np.testing.assert_allclose(shown["force"][k], force[until - stride : until].max(axis=0), atol=6e-5)
        assert shown["output"][k] == pytest.approx(out[round(until * taped.step_s * RATE_HZ)], abs=1e-6)


@pytest.mark.parametrize(("name", "note"), [("fretted-bass", 40), ("tanpura-light", 36), ("jawari-harp", 96)])
def test_the_film_shows_all_modes_the_lumped_ones_too(name: str, note: int) -> None:
    place = find(preset(name), note)
    position, scene = Taped(place).position, speaking(place)
    assert position.omega.size > position.own
    shapes = motion.shapes_at(scene, position, np.asarray(scene.reached.positions_m))
    np.testing.assert_allclose(shapes, position.shapes, rtol=1e-6, atol=1e-9 * np.abs(position.shapes).max())


@pytest.mark.parametrize(("name", "note", "velocity"), NOTES)
def test_the_string_stays_above_what_it_touches(name: str, note: int, velocity: int) -> None:
    shown = film(preset(name), note, velocity, 0.06, 250)
    json.dumps(shown, allow_nan=False)
    frames = np.array(shown["frames"])
    assert frames.shape == (250, len(shown["x"])) and shown["x"] == sorted(shown["x"])
    for point in shown["points"]:
        height = frames[:, point["at"]]
        assert abs(shown["x"][point["at"]] - point["x"]) < 2e-6
        assert height.min() > point["height"] - 2e-3  # [mm], what the residual compliance and rounding give way by
    assert len(json.dumps(shown)) < 500_000


@pytest.mark.parametrize(
    ("name", "note", "velocity", "start_s"), [("fretted-bass", 40, 127, 0.01), ("tanpura-light", 36, 90, 0.1)]
)
def test_points_light_up_when_the_string_is_on_them(name: str, note: int, velocity: int, start_s: float) -> None:
    shown = film(preset(name), note, velocity, 0.009, 300, start_s=start_s)
    heights, force = np.array(shown["frames"]), np.array(shown["force"])
    touched = 0
    for k, point in enumerate(shown["points"]):
        above = heights[:, point["at"]] - point["height"]
        nearest = np.minimum(above[:-1], above[1:])  # at the ends of the time in which a frame's force acts
        fastest = np.abs(np.diff(above)).max()
        lit = force[1:, k] > 0.0
        assert nearest[lit].max(initial=0.0) <= fastest and np.all(force[1:, k][nearest > fastest] == 0.0)
        touched += int(lit.any())
    assert touched >= 1 and shown["largest_n"] > 0.0


def test_the_finger_draws_the_string_as_far_as_it_is_drawn() -> None:
    shown = film(load_preset("tanpura-light"), 48, 127, 0.02, 100)
    drawn = [k for k, height in enumerate(shown["finger"]) if height is not None]
    assert drawn == list(range(drawn[-1] + 1))
    last = drawn[-1]
    assert shown["start_s"] + last * shown["dt_s"] == pytest.approx(shown["release_s"], abs=2 * shown["dt_s"])
    assert shown["finger"][last] == pytest.approx(3.0, rel=1e-3)
    at = int(np.argmin(np.abs(np.array(shown["x"]) - shown["finger_x"])))
    assert shown["frames"][last][at] == pytest.approx(3.0, rel=0.05)  # its tip is flat over the finger's width
    assert np.abs(np.subtract(shown["frames"][0], shown["rest"])).max() < 1e-3
    assert shown["rest"][-1] == draw(load_preset("tanpura-light"), 48)["thread"]["height"] > 0.0


def test_a_film_from_later_on_is_a_part_of_the_longer_one() -> None:
    whole = film(load_preset("fretted-bass"), 40, 120, 0.08, 221)
    step = whole["dt_s"]
    part = film(load_preset("fretted-bass"), 40, 120, 60 * step, 61, start_s=100 * step)
    assert part["dt_s"] == step and part["start_s"] == pytest.approx(100 * step)
    assert part["frames"] == whole["frames"][100:161]
    assert part["force"][1:] == whole["force"][101:161] and part["output"] == whole["output"][100:161]


@pytest.mark.parametrize(("quality", "rate_hz"), [("draft", 44100.0), ("fine", 48000.0)])
def test_a_film_is_of_the_quality_and_rate_asked_for(quality: str, rate_hz: float) -> None:
    shown = film(tanpura(), 48, 90, 0.05, 100, quality=quality, rate_hz=rate_hz)
    (string,) = compile_preset(find(tanpura(), 48).preset, quality=quality, rate_hz=rate_hz).strings
    assert shown["rate_hz"] == string.positions[0].plan.rate_hz and shown["rate_hz"] % rate_hz == 0.0
    assert 0.045 < shown["dt_s"] * 99 < 0.055


@pytest.mark.parametrize(("name", "note", "velocity"), [("fretted-bass", 40, 127), ("tanpura-light", 48, 90)])
def test_film_and_analysis_have_the_same_contacts(name: str, note: int, velocity: int) -> None:
    shown = film(preset(name), note, velocity, 0.3, 300)
    until = shown["dt_s"] * (len(shown["frames"]) - 1)
    heard = analyse(preset(name), note, velocity, until)
    film_impulse = dict(zip((p["label"] for p in shown["points"]), np.sum(shown["impulse"], axis=0), strict=True))
    assert heard["timeline"]["points"]
    for row, point in enumerate(heard["timeline"]["points"]):
        total = sum(heard["timeline"]["impulse_ns"][row])
        assert film_impulse[point["label"]] == pytest.approx(total, rel=0.02)
    assert max(p["peak_n"] for p in heard["timeline"]["points"]) == pytest.approx(shown["largest_n"], rel=1e-3)


def test_a_film_over_as_many_points_as_there_can_be_is_bounded() -> None:
    places, heights = [13.0 * k for k in range(1, 65)], [-0.4] * 64
    crowded = preset("free").with_setting(
        "obstacle", f'{{kind = "points", positions_mm = {places}, heights_mm = {heights}}}'
    )
    shown = film(crowded, 48, 127, 0.05, MOST_FRAMES)
    assert len(shown["points"]) == 64 and shown["largest_n"] > 0.0
    assert len(json.dumps(shown, separators=(",", ":"))) < 500_000


def test_a_string_that_meets_nothing_has_no_forces() -> None:
    assert not np.any(film(tanpura(900.0), 48, 64)["force"])
    free = film(preset("free"), 48, 100)
    assert free["points"] == [] and free["force"][0] == [] and free["largest_n"] == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 1}, f"frames must lie between 2 and {MOST_FRAMES}, got 1"),
        ({"frames": MOST_FRAMES + 1}, "frames must lie"),
        ({"seconds": 0.0}, "the film must lie within"),
        ({"start_s": -1.0}, "the film must lie within"),
        ({"start_s": 9.9, "seconds": 0.2}, "the film must lie within"),
        ({"seconds": float("nan")}, "the film must lie within"),
    ],
)
def test_impossible_films_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        film(load_preset("tanpura-light"), 48, **options)  # type: ignore[arg-type]
    with pytest.raises(PresetError, match="no string plays"):
        film(load_preset("tanpura-light"), 60)
