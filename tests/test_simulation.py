"""The research door: exact solutions, convergence, the project's cases, the authors' own runs, files and faults."""

from __future__ import annotations

import io
import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest

from synth.dsp.measures import relative_error
from synth.physics.modes import count_modes_below, static_compliance
from synth.research.exact import waveguide
from synth.research.simulation import Case, CaseError, Scene, case_folder, load_case, simulate, simulate_file

REFERENCE = Path(os.environ.get("JAWARI_REFERENCE", Path(__file__).resolve().parents[2] / "shared" / "reference"))
needs_reference = pytest.mark.skipif(
    not (REFERENCE / "authors_data.npz").is_file(), reason=f"no reference data in {REFERENCE}"
)


def ideal(length=1.0, speed=400.0, **tables):
    """A case on an ideal lossless string, c = 400 m/s, L = 1 m unless said."""
    mu = 1e-3
    case = {
        "string": {
            "length_m": length,
            "tension_n": mu * speed**2,
            "linear_density_kg_m": mu,
            "diameter_m": 4e-4,
            "air_viscosity": 0.0,
            "air_density": 0.0,
        },
        "run": {"internal_rate_hz": 64e3, "modes": 40, "duration_s": 0.01, "outputs_m": [0.3]},
    }
    for name, table in tables.items():
        case[name] = {**case.get(name, {}), **table} if isinstance(table, dict) else table
    return case


STIFF = {
    "length_m": 0.863,
    "tension_n": 191.6,
    "linear_density_kg_m": 6.69e-3,
    "diameter_m": 1.14e-3,
    "inharmonicity": 3.5e-5,
    "viscoelastic_loss": 0.01,
}


# --- free flight --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [3_000.0, 44_100.0, 1e6])
def test_free_flight_is_exact_at_any_rate(rate):
    """A stiff lossy string clear of its obstacle, against the closed form, to rounding; 3 kHz is far below its modes."""
    case = {
        "string": STIFF,
        "obstacle": {"positions_m": [0.4], "heights_m": [-0.1]},
        "initial": {"shape": "triangle", "position_m": 0.2, "displacement_m": 2e-3, "width_m": 0.02},
        "run": {"internal_rate_hz": rate, "output_rate_hz": 100.0, "modes": 50, "duration_s": 0.1, "outputs_m": [0.8]},
    }
    result = simulate(case)
    scene = Scene(Case.model_validate(case), Path())
    q, _ = scene.initial()
    w, s, t = scene.model.modes.omega, scene.model.modes.sigma, result.t[:, None]
    root = np.sqrt((w**2 - s**2).astype(complex))
    motion = (np.exp(-s * t) * (np.cos(root * t) + s * np.sin(root * t) / root)).real * q
    rounding = 1e-12 + 0.1 * rate * np.finfo(float).eps  # an ulp a step
    np.testing.assert_allclose(result.u[:, 0], motion @ scene.model.out_shapes[0], rtol=0, atol=rounding * 2e-3)
    assert np.isnan(result.last_contact_s) and result.largest_penetration_m < 0
    assert not np.any(result.contact_force)


@pytest.mark.parametrize("scheme", ["moreau-jean", "moreau-jean-filtered"])
def test_moreau_jean_starts(scheme):
    """Free flight: exact from the exact start; the published one, w⁰ = 0, is another motion."""
    case = ideal(
        initial={"shape": "triangle", "position_m": 0.3, "displacement_m": 1e-3, "width_m": 0.1},
        scheme={"name": scheme},
    )
    exact = simulate(case, scheme="exact-hold").u
    np.testing.assert_allclose(simulate(case).u, exact, rtol=0, atol=1e-12 * 1e-3)
    published = simulate(case, start="published").u
    # q(−Δt) = q(0) is the motion from half a step later: first order in ωΔt/2
    assert 1e-4 < relative_error(published, exact) < 0.2


# --- exact solutions ----------------------------------------------------------------------------------------------------


def test_ideal_string_converges_to_the_exact_motion():
    """A point under an ideal string, modes far beyond the rate: order 1 ± 0.15 over five halvings, against waves.

    An ideal string over a point obstacle has no restitution to choose, so the scheme converges for Δt → 0 with ωΔt
    large. With few modes and no residual compliance it does not: what a rigid stop returns then depends on where in
    the step the blow falls. One place's error falls by jumps, as its reflections come to meet the time grid or not;
    the order is that of the mean over nine places.
    """
    cells, duration, common = 8000, 0.01, 16_000.0
    x = np.linspace(0.0, 1.0, cells + 1)
    j = np.arange(1, 41)
    q = 1e-3 * np.sin(j * np.pi * 0.3) / j**2 * np.exp(-((j / 15.0) ** 2))
    start = np.sqrt(2.0) * np.sin(np.pi * np.outer(x, j)) @ q
    outputs = [0.1, 0.4, 0.5, 0.8]
    errors = np.zeros((9, 6))
    for place, node in enumerate(np.random.default_rng(0).integers(cells // 10, 9 * cells // 10, 9)):
        waves = waveguide.travelling(start, None, 400.0)
        places = np.array([round(p * cells) for p in outputs])
        steps, every = round(duration * 400.0 * cells), round(400.0 * cells / common)
        exact = waveguide.run(*waves, np.array([node]), np.array([-2e-4]), places, steps, every, 160.0, 1.0).u
        for k in range(6):
            result = simulate(
                ideal(
                    obstacle={"positions_m": [node / cells], "heights_m": [-2e-4]},
                    initial={"shape": "modes", "q": q},
                    run={
                        "internal_rate_hz": common * 2**k,
                        "output_rate_hz": common,
                        "modes": 4000,
                        "duration_s": duration,
                        "outputs_m": outputs,
                    },
                )
            )
            assert np.any(result.contact_force > 0)
            errors[place, k] = np.abs(result.u - exact).max()
    mean = np.log2(errors).mean(axis=0)
    order = -np.polyfit(np.arange(6), mean, 1)[0]
    assert 0.85 < order < 1.15, (order, 2.0**mean)


@pytest.mark.parametrize("position", [0.3, 0.45])
def test_order_of_convergence_with_residual_compliance(position):
    """Few modes of a stiff lossy string, the rest as R: order 1 ± 0.15 over five halvings, max norm of q."""
    modes = 10
    points = np.arange(1, modes + 1) / (modes + 1)
    case = {
        "string": {**STIFF, "length_m": 1.0, "tension_n": 160.0, "linear_density_kg_m": 1e-3, "inharmonicity": 1e-4},
        "obstacle": {"positions_m": [position], "heights_m": [-0.4e-3]},
        "initial": {"shape": "triangle", "position_m": 0.4, "displacement_m": 2e-3, "width_m": 0.3},
        "scheme": {"tail": "static"},
        "run": {"internal_rate_hz": 50e3, "output_rate_hz": 25e3, "modes": modes, "duration_s": 0.008, "outputs_m": points},
    }

    def q_of(rate):
        result = simulate(case, internal_rate_hz=rate)
        assert np.count_nonzero(np.diff((result.contact_force[:, 0] > 0).astype(int)) > 0) >= 2
        shapes = np.sqrt(2.0) * np.sin(np.pi * np.outer(points, np.arange(1, modes + 1)))
        return np.linalg.solve(shapes, result.u.T)

    fine = q_of(200e3 * 2**9)
    errors = [np.abs(q_of(200e3 * 2**k) - fine).max() for k in range(6)]
    order = -np.polyfit(np.arange(6), np.log2(errors), 1)[0]
    assert 0.85 < order < 1.15, (order, errors)


@pytest.mark.parametrize("height", [0.0, -0.5])
def test_cabannes_obstacle_at_mid_string(height):
    """A triangle over a point at mid-string at h times its height: periodic with (3 − h)/2 · L/c (Cabannes 1984)."""
    amplitude, speed = 1e-3, 400.0
    period = (3.0 - height) / 2.0 / speed
    rate = 64_000.0
    rows = round(period * rate)
    case = ideal(
        obstacle={"positions_m": [0.5], "heights_m": height * amplitude},
        initial={"shape": "triangle", "position_m": 0.5, "displacement_m": amplitude},
        run={"internal_rate_hz": rate, "modes": 1500, "duration_s": 2.0 * rows / rate, "outputs_m": [0.5, 0.25]},
    )
    result = simulate(case)
    assert abs(rows / rate - period) < 0.5 / rate
    first, second = result.u[: rows + 1], result.u[rows:]
    assert relative_error(second, first) < 0.03
    assert np.any(result.contact_force > 0)
    # it is not the free motion's period, 2L/c
    assert relative_error(result.u[rows + 80 :][:80], result.u[:80]) > 0.1


def test_flat_wall_at_rest_height_doubles_the_frequency():
    """Points all along at η = 0: u = |free solution|, to first order in the grid."""
    n = 200
    x = np.arange(1, n) / n
    case = ideal(
        obstacle={"positions_m": x, "heights_m": 0.0},
        initial={"shape": "modes", "q": [1e-3]},
        run={"internal_rate_hz": 400.0 * n, "modes": n - 1, "duration_s": 0.012, "outputs_m": [0.5, 0.2]},
        scheme={"name": "moreau-jean-filtered", "restitution": 1.0},
    )
    result = simulate(case)
    shape = np.sqrt(2) * np.sin(np.pi * np.array([0.5, 0.2])) * 1e-3
    expected = np.abs(np.cos(np.pi * 400.0 * result.t)[:, None] * shape)
    assert relative_error(result.u, expected) < 0.02


def test_string_thrown_flat_against_a_point():
    """All of a string starts with v₀ against a point at mid-string at rest height: a constant force 2 √(Tμ) |v₀|.

    Two half-strings of impedance √(Tμ) resist, until the wave that starts at the ends arrives after L/2c.
    """
    speed, mu, throw = 400.0, 1e-3, -0.5
    modes = 2001
    j = np.arange(1, modes + 1)
    v = throw * np.sqrt(2.0) * (1 - np.cos(j * np.pi)) / (j * np.pi)  # ∫ φ_j dx
    result = simulate(
        ideal(
            obstacle={"positions_m": [0.5], "heights_m": [0.0]},
            initial={"shape": "modes", "q": np.zeros(modes), "v": v},
            run={
                "internal_rate_hz": 200e3,
                "output_rate_hz": 10e3,
                "modes": modes,
                "duration_s": 0.004,
                "outputs_m": [0.5],
            },
        )
    )
    force = result.contact_force[:, 0]
    during = (result.t > 0) & (result.t < 0.49 / speed)
    assert during.sum() >= 10
    np.testing.assert_allclose(force[during], 2.0 * mu * speed * -throw, rtol=0.01)
    assert np.all(result.u_contact >= -1e-15)


# --- residual compliance, static starts -----------------------------------------------------------------------------------


@pytest.mark.parametrize("modes", [20, 200])
def test_string_pressed_down_by_a_point_lies_on_it(modes):
    """A point raised under a string at rest: force height/G(x, x), the closed Green function, whatever the modes."""
    case = {
        "string": STIFF,
        "obstacle": {"positions_m": [0.3], "heights_m": [1e-3]},
        "run": {"internal_rate_hz": 20e3, "modes": modes, "duration_s": 0.05, "outputs_m": [0.3], "ledger": True},
    }
    result = simulate(case)
    string = Scene(Case.model_validate(case), Path()).string
    expected = 1e-3 / float(static_compliance(string, 0.3, 0.3))
    np.testing.assert_allclose(result.contact_force, expected, rtol=1e-6)
    np.testing.assert_allclose(result.u_contact, 1e-3, atol=1e-15)
    assert result.summary["started_from_static_contact"] and result.metadata["start"] == "static contact"
    assert 0 < result.summary["lifted_m"] <= 1e-3
    # work of lifting is all there is, and it stays
    energy = result.energy_stored + result.energy_residual
    np.testing.assert_allclose(energy, 0.5 * expected * 1e-3, rtol=1e-6)
    assert result.largest_energy_rise <= 1e-12


def test_finger_draws_and_lets_go():
    """Drawn to 2 mm over 50 ms and let go: what it gave is what the string has, and it sounds."""
    case = {
        "string": STIFF,
        "obstacle": {"positions_m": [0.3], "heights_m": [-1.2e-3]},
        "finger": [
            {"position_m": 0.6, "displacement_m": 2e-3, "draw_s": 0.05},
            {"position_m": 0.65, "displacement_m": -1e-3, "draw_s": 0.03, "start_s": 0.07, "resistance_n_s_m": 5.0},
        ],
        "run": {
            "internal_rate_hz": 96e3,
            "output_rate_hz": 48e3,
            "modes": 60,
            "duration_s": 0.15,
            "outputs_m": [0.6, 0.65],
            "ledger": True,
        },
    }
    result = simulate(case)
    drawn = np.searchsorted(result.t, 0.05)
    # drawn slowly, finger and string are two springs in a row
    string = Scene(Case.model_validate(case), Path()).string
    stiffness = 1.0 / float(static_compliance(string, 0.6, 0.6))
    held = 2e-3 * 1e5 / (1e5 + stiffness)
    assert result.u[drawn, 0] == pytest.approx(held, rel=0.005)
    assert result.energy_injected[drawn] == pytest.approx(0.5 * stiffness * held**2, rel=0.03)
    total = result.energy_stored + result.energy_residual + result.energy_viscous + result.energy_contact
    np.testing.assert_allclose(total, result.energy_injected, rtol=0, atol=1e-11 * total.max())
    assert result.largest_energy_rise <= 1e-12
    # the second finger takes hold of a string that sounds: nothing jumps by more than it moved before
    jump = np.abs(np.diff(result.u[:, 1]))
    hold = np.searchsorted(result.t, 0.07)
    assert jump[hold : hold + 5].max() <= 1.5 * jump[drawn + 10 : hold].max()
    assert np.abs(result.u[-500:, 0]).max() > 1e-4


# --- the project's cases ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tanpura_44100():
    """The reference of the tanpura case at 44.1 kHz, and how far half its rate is from it."""
    fine = simulate("tanpura", internal_rate_hz=2_116_800, residual_compliance=False)
    half = simulate("tanpura", internal_rate_hz=1_058_400, residual_compliance=False)
    assert relative_error(half.u, fine.u) < 0.003, "the reference must be converged"
    return fine.u


def below_half(case, rate):
    return count_modes_below(Scene(load_case(case), case_folder()).string, rate / 2)


@pytest.mark.parametrize("rate", [44_100, 88_200])
def test_tanpura_default_scheme_meets_the_criterion(tanpura_44100, rate):
    """e < 0.1 over 3 s, the criterion of the paper, with the modes below half the rate and the rest as R."""
    modes = below_half("tanpura", rate)
    result = simulate("tanpura", internal_rate_hz=rate, modes=modes)
    assert relative_error(result.u, tanpura_44100) < 0.1
    without = simulate("tanpura", internal_rate_hz=rate, modes=modes, residual_compliance=False)
    assert relative_error(without.u, tanpura_44100) > 3 * relative_error(result.u, tanpura_44100)


def test_tanpura_with_substeps_at_the_output_rate(tanpura_44100):
    """e < 0.02 over 3 s with 120 coordinates at 44.1 kHz; static compliance needs 238 modes at 132 kHz for that."""
    result = simulate("tanpura", internal_rate_hz=44_100, modes=118, substeps=2)
    assert result.summary["lumped_modes"] == 2 and result.summary["substeps"] == 2
    assert relative_error(result.u, tanpura_44100) < 0.02
    static = simulate("tanpura", internal_rate_hz=88_200, output_rate_hz=44_100, modes=179, tail="static")
    assert relative_error(result.u, tanpura_44100) < relative_error(static.u, tanpura_44100)


@pytest.mark.parametrize("name", ["tanpura", "bass"])
def test_substeps_and_lumped_modes_never_gain_energy(name):
    result = simulate(name, internal_rate_hz=44_100, modes=100, substeps=3, duration_s=0.05, ledger=True)
    assert result.largest_energy_rise <= 1e-12 and result.largest_penetration_m <= 1e-12
    total = result.energy_stored + result.energy_residual + result.energy_viscous + result.energy_contact
    np.testing.assert_allclose(total, total[0], rtol=1e-12)
    assert result.summary["contact_steps"] > 20
    plain = simulate(name, internal_rate_hz=44_100, modes=100, substeps=3, duration_s=0.05)
    np.testing.assert_allclose(plain.u, result.u, rtol=0, atol=1e-8 * np.abs(result.u).max())
    np.testing.assert_allclose(
        plain.contact_force, result.contact_force, rtol=0, atol=1e-6 * np.abs(result.contact_force).max()
    )


def test_tail_by_name():
    common = {"internal_rate_hz": 44_100, "modes": 60, "duration_s": 0.01}
    runs = {tail: simulate("tanpura", tail=tail, **common) for tail in ("lumped", "static", "none")}
    np.testing.assert_array_equal(runs["lumped"].u, simulate("tanpura", **common).u)
    np.testing.assert_array_equal(runs["none"].u, simulate("tanpura", residual_compliance=False, **common).u)
    assert not np.array_equal(runs["static"].u, runs["lumped"].u)
    assert runs["lumped"].summary["modes"] == runs["static"].summary["modes"] == 60
    assert "lumped_modes" not in runs["static"].summary
    with pytest.raises(CaseError, match="contradict each other"):
        simulate("tanpura", tail="static", residual_compliance=False, **common)
    with pytest.raises(CaseError, match="tail"):
        simulate("tanpura", tail="soft", **common)
    with pytest.raises(CaseError, match="only exact-hold takes substeps"):
        simulate("tanpura", substeps=2, scheme="moreau-jean", **common)
    with pytest.raises(CaseError, match="substeps"):
        simulate("tanpura", substeps=0, **common)


def test_what_lumped_modes_and_substeps_do_not_go_with():
    """A bend carries R along, not lumped modes; a moving obstacle takes whole steps; a wall of points has R."""
    common = {"run": {"internal_rate_hz": 44_100.0, "modes": 60, "duration_s": 0.01, "outputs_m": [0.9]}}
    tanpura = load_case("tanpura").model_dump(exclude_none=True) | common
    bent = tanpura | {"bend": [{"duration_s": 0.005, "cents": 50.0}]}
    np.testing.assert_array_equal(simulate(bent).u, simulate(bent, tail="static").u)
    with pytest.raises(CaseError, match="lumped modes do not follow a bend"):
        simulate(bent, tail="lumped")
    ramp = {"motion": {"ramp": [{"duration_s": 0.01, "displacement_m": 1e-4}]}}
    with pytest.raises(CaseError, match="not over a moving obstacle"):
        simulate(tanpura | {"obstacle": tanpura["obstacle"] | ramp}, substeps=2)
    points = {"positions_m": [0.1 + 0.02 * k for k in range(20)], "heights_m": -1e-4}
    assert "lumped_modes" not in simulate(tanpura | {"obstacle": points}).summary
    assert 20 <= simulate(tanpura | {"obstacle": points}, tail="lumped").summary["lumped_modes"] <= 40


def test_tanpura_moreau_jean_needs_two_megahertz():
    """Both forms: e < 0.1 over 3 s at 2 MHz with 1001 modes; the same cost as a reference."""
    common = {"internal_rate_hz": 2e6, "output_rate_hz": 40e3, "residual_compliance": False}
    reference = simulate("tanpura", **common).u
    for scheme in ("moreau-jean", "moreau-jean-filtered"):
        assert relative_error(simulate("tanpura", scheme=scheme, restitution=0.0, **common).u, reference) < 0.1


def test_bass_case_errors_fall_with_the_rate():
    """20 frets, 0.4 s: chaotic contacts, so only the trend is asked for, and an end to the contacts."""
    reference = simulate("bass", internal_rate_hz=2_116_800)
    assert reference.last_contact_s < 0.25 and reference.summary["unsolved_steps"] == 0
    first = slice(0, 442)
    errors = [
        relative_error(simulate("bass", internal_rate_hz=rate, duration_s=0.01).u, reference.u[first])
        for rate in (44_100, 176_400, 705_600)
    ]
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.02, errors


def test_case_files_are_the_papers():
    tanpura, bass = load_case("tanpura"), load_case("bass")
    assert (tanpura.run.modes, tanpura.run.duration_s, tanpura.run.outputs_m) == (1001, 3.0, [0.992])
    assert (tanpura.obstacle.positions_m, tanpura.obstacle.heights_m) == ([0.006], [0.0])
    from synth.physics.obstacle import BASS_FRETS

    assert tuple(bass.obstacle.positions_m) == BASS_FRETS.positions_m
    np.testing.assert_allclose(bass.obstacle.heights_m, BASS_FRETS.heights_m, rtol=1e-12)


# --- the authors' own solver ------------------------------------------------------------------------------------------


def measured_case(kind, **run):
    """The authors' published modes and start, as a case."""
    if kind == "tanpura":
        string = {"length_m": 1.002, "tension_n": 180.5, "linear_density_kg_m": 1.17e-3, "inharmonicity": 1.78e-5}
        keys, initial = ("one_f", "one_sig"), {"file": "tanpura_q0.npz", "q": "q0"}
        obstacle, modes = {"positions_m": [0.006], "heights_m": [0.0]}, 1001
    else:
        string = {"length_m": 0.863, "tension_n": 191.6, "linear_density_kg_m": 6.7e-3, "inharmonicity": 3.5e-5}
        keys, initial = ("bass_f", "bass_sig"), {"file": "authors_data.npz", "q": "bass_q2"}
        obstacle, modes = load_case("bass").obstacle.model_dump(exclude={"frets"}), 862
    initial["file"] = str(REFERENCE / initial["file"])
    return {
        "string": {
            **string,
            "diameter_m": 1e-3,
            "measured": {
                "file": str(REFERENCE / "authors_data.npz"),
                "frequencies": keys[0],
                "decay_rates": keys[1],
            },
        },
        "obstacle": obstacle,
        "initial": {"shape": "modes", **initial},
        "run": {"modes": modes, "duration_s": 0.1, "outputs_m": [0.992 if kind == "tanpura" else 0.854], **run},
    }


@needs_reference
@pytest.mark.parametrize("path", sorted(REFERENCE.glob("siconos_*.npz")), ids=lambda path: path.stem)
def test_filtered_form_is_what_the_authors_solver_runs(path):
    with np.load(path) as run:
        case = measured_case("bass" if "bass" in path.stem else "tanpura", internal_rate_hz=float(run["fs"]))
        np.testing.assert_allclose(case["obstacle"]["positions_m"], run["xc"], rtol=1e-12)
        np.testing.assert_allclose(case["obstacle"]["heights_m"], run["h"], rtol=1e-9, atol=1e-15)
        case["scheme"] = {"name": "moreau-jean-filtered", "restitution": float(run["e"]), "start": "published"}
        result = simulate(case)
        assert result.u.shape == (run["u"].size, 1)
        np.testing.assert_allclose(result.u[:, 0], run["u"], rtol=0, atol=1e-11)
        impulse = result.contact_force[1:] / result.metadata["internal_rate_hz"] / 1.17e-3
        if "tanpura" in path.stem:
            np.testing.assert_allclose(impulse, run["impulse_over_mu"][1:], rtol=0, atol=1e-7 * impulse.max())


@needs_reference
def test_default_scheme_on_the_measured_modes():
    """The criterion once more, on modes that no model made: e < 0.1 over 3 s at 44.1 and 88.2 kHz."""
    case = measured_case("tanpura", internal_rate_hz=2_116_800, output_rate_hz=44_100, duration_s=3.0)
    reference = simulate(case, residual_compliance=False).u
    for rate in (44_100, 88_200):
        modes = int(np.searchsorted(Scene(Case.model_validate(case), Path()).model.modes.omega, np.pi * rate))
        result = simulate(case, internal_rate_hz=rate, modes=modes)
        assert relative_error(result.u, reference) < 0.1


# --- files, dicts, faults ---------------------------------------------------------------------------------------------


def small(**overrides):
    return simulate("tanpura", internal_rate_hz=44_100, modes=20, duration_s=0.01, **overrides)


def test_result_file_holds_what_the_call_gives(tmp_path):
    overrides = {"rate": 88_200, "modes": 20, "duration": 0.01, "scheme": "moreau-jean", "restitution": 0.5, "ledger": True}
    summary = simulate_file(case_folder() / "tanpura.toml", tmp_path / "out.npz", overrides)
    result = simulate("tanpura", **overrides)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as saved:
        for name in ("t", "u", "u_contact", "contact_force", "energy_stored", "energy_viscous", "energy_contact"):
            np.testing.assert_array_equal(saved[name], getattr(result, name))
        metadata = json.loads(str(saved["metadata"]))
        assert float(saved["largest_penetration_m"]) == result.largest_penetration_m
    assert metadata["scheme"] == "moreau-jean" and metadata["restitution"] == 0.5
    assert metadata["internal_rate_hz"] == 88_200 and metadata["modes"] == 20
    assert metadata["case"]["string"]["tension_n"] == 180.5
    assert summary["steps"] == 882 and summary["rows"] == 442
    assert os.listdir(tmp_path) == ["out.npz"]
    json.dumps(summary)


def test_a_run_that_fails_leaves_no_file(tmp_path):
    with pytest.raises(ValueError):
        simulate_file(case_folder() / "tanpura.toml", tmp_path / "out.npz", {"modes": 0})
    with pytest.raises(FileNotFoundError, match="no directory"):
        simulate_file(case_folder() / "tanpura.toml", tmp_path / "nowhere" / "out.npz", {"modes": 5})
    assert os.listdir(tmp_path) == []


def test_output_rate_only_chooses_rows():
    every, seldom = small(output_rate_hz=44_100), small(output_rate_hz=4_410)
    np.testing.assert_array_equal(every.u[::10], seldom.u)
    np.testing.assert_array_equal(every.t[::10], seldom.t)


def test_ledger_does_not_change_the_run():
    """One step at a time, weighed, or in blocks: the same to rounding."""
    plain, weighed = small(), small(ledger=True)
    np.testing.assert_allclose(plain.u, weighed.u, rtol=0, atol=1e-12 * np.abs(plain.u).max())
    assert plain.energy_stored is None and np.isnan(plain.largest_energy_rise)
    assert weighed.energy_stored[0] > 0


def test_restitution_matters_to_moreau_jean_only():
    for scheme, same in (("moreau-jean", False), ("moreau-jean-filtered", False), ("exact-hold", True)):
        zero, one = (small(scheme=scheme, restitution=e).u for e in (0.0, 1.0))
        assert np.array_equal(zero, one) == same


def test_measured_modes_replace_the_first_ones(tmp_path):
    np.savez(tmp_path / "modes.npz", f=[100.0, 205.0], sig=[1.0, 2.0, 3.0])
    case = tmp_path / "case.toml"
    case.write_text(
        """
        [string]
        length_m = 1.0
        tension_n = 40.0
        linear_density_kg_m = 1e-3
        diameter_m = 4e-4
        measured = {file = "modes.npz"}
        [initial]
        shape = "modes"
        file = "modes.npz"
        q = "f"
        [run]
        internal_rate_hz = 10000
        modes = 5
        duration_s = 0.001
        outputs_m = [0.5]
        """
    )
    model = Scene(load_case(case), tmp_path).model
    np.testing.assert_allclose(model.modes.omega[:3] / (2 * np.pi), [100.0, 205.0, 300.0], rtol=1e-12)
    np.testing.assert_allclose(model.modes.sigma[:3], [1.0, 2.0, 3.0])
    assert simulate(case).u[0, 0] == pytest.approx(np.sqrt(2) * 100.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"string": {"length_m": -1.0}}, r"string\.length_m: .*greater than 0, got -1"),
        ({"string": {"lenght_m": 1.0}}, r"string\.lenght_m: no such key"),
        ({"string": {"inharmonicity": 1e-5, "bending_stiffness_n_m2": 1e-5}}, "give one of them"),
        ({"run": {"output_rate_hz": 7000.0}}, "whole multiple of output_rate_hz, got 64000 and 7000 Hz"),
        ({"run": {"modes": 2.5}}, r"run\.modes"),
        ({"scheme": {"name": "penalty"}}, "scheme: unknown contact scheme 'penalty'; use one of exact-hold"),
        ({"scheme": {"restitution": 1.5}}, r"scheme\.restitution: .*got 1\.5"),
        ({"initial": {"shape": "triangle", "position_m": 0.3}}, "'triangle' needs displacement_m"),
        ({"initial": {"shape": "rest", "q": [1.0]}}, "'rest' does not take q"),
        ({"initial": {"shape": "modes", "q": "q0"}}, "name the .npz file"),
        ({"initial": {"shape": "modes", "file": "gone.npz", "q": "q0"}}, "gone.npz does not exist"),
        ({"obstacle": {"positions_m": [0.3]}}, "must be given together"),
        ({"obstacle": {"positions_m": [1.3], "heights_m": [0.0]}}, "must be less than the string's length"),
        ({"obstacle": {"positions_m": [0.5, 0.4], "heights_m": 0.0}}, "sort the points"),
        ({"run": {"outputs_m": [2.0]}}, "positions must lie between 0 and 1 m"),
        ({"run": {"duration_s": 1e7}}, "GiB"),
        ({"run": {"duration_s": 1e8, "output_rate_hz": 0.5}}, "mode-steps"),
        ({"finger": [{"position_m": 0.3, "displacement_m": 1e-3}]}, r"finger\.0\.draw_s: missing"),
        ({"finger": [{"position_m": 3.0, "displacement_m": 1e-3, "draw_s": 0.1}]}, r"finger\.position_m: must lie"),
        ({"string": {"length_m": True}}, r"string\.length_m: must be a number, got True"),
        ({"run": {"modes": "40"}}, r"run\.modes: must be a whole number, got '40'"),
        ({"run": 3}, "run: must be a table, got 3"),
        ({"obstacle": 3}, "obstacle: must be a table, got 3"),
        ({"obstacle": {"positions_m": [0.3], "heights_m": "low"}}, "heights_m: must be a list or a number, got 'low'"),
        ({"obstacle": {"positions_m": [0.3], "heights_m": [np.nan]}}, r"^case: obstacle\.heights_m\.0: .*finite[^\n]*$"),
        ({"obstacle": {"wall": {"from_m": 0.0, "to_m": 1.0, "height_m": 0.0, "nodes": 10**9}}}, "points are too many"),
        ({"obstacle": {"wall": {"from_m": 0.0, "to_m": 1.0, "height_m": 0.0, "nodes": 10**5}}}, "GiB"),
        ({"string": {"length_m": 1e300, "inharmonicity": 1e-5}}, "string: length_m .*, got 1e.300; check the unit"),
        ({"bend": [{"duration_s": 1e-3, "cents": 1e300}]}, r"bend\.0\.cents: .*36000 cents, got 1e\+300; check"),
        ({"initial": {"shape": "modes", "file": "x.npz", "q": [1.0]}}, "neither q nor v is a key of it"),
    ],
)
def test_faults_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        simulate(ideal(**change))


def test_faults_in_files_and_names(tmp_path):
    with pytest.raises(CaseError, match=r"not one of bass, .*tanpura"):
        simulate("lyre")
    broken = tmp_path / "broken.toml"
    broken.write_text("[string\n")
    with pytest.raises(CaseError, match=r"broken\.toml: not valid TOML"):
        simulate(broken)
    broken.write_text("[string]\nlength_m = 1.0\n")
    with pytest.raises(CaseError) as fault:
        simulate(broken)
    assert "string.tension_n" in str(fault.value) and "run: missing" in str(fault.value)
    with pytest.raises(CaseError, match="no override 'speed'"):
        small(speed=3)
    with pytest.raises(CaseError, match="internal_rate_hz and rate are the same"):
        small(rate=88_200)
    with pytest.raises(FileNotFoundError):
        simulate(tmp_path / "gone.toml")


def test_names_of_cases(tmp_path, monkeypatch):
    """A folder of a case's name is no case; what lies beside the program's cases is none either."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tanpura").mkdir()
    assert load_case("tanpura").string.length_m == 1.002
    with pytest.raises(CaseError, match="is a folder"):
        load_case(tmp_path)
    with pytest.raises(CaseError, match="is not one of"):
        load_case("../tanpura")
    with pytest.raises(CaseError, match="perhaps hard/two-close"):
        load_case("two-close")
    text = (case_folder() / "tanpura.toml").read_text(encoding="utf-8")
    (tmp_path / "marked.toml").write_text(text, encoding="utf-8-sig")
    assert load_case("marked.toml") == load_case("tanpura")
    (tmp_path / "deep.toml").write_text("x = " + 5000 * "[")
    with pytest.raises(CaseError, match=r"deep\.toml: not valid TOML"):
        load_case("deep.toml")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", "row", "complex"])
def test_files_that_hold_no_modes(tmp_path, content):
    """One line that names the file, whatever it is."""
    path = tmp_path / "modes.npz"
    if content == "row":
        with open(path, "wb") as file:
            np.save(file, np.ones(3))
    elif content == "complex":
        np.savez(path, f=[100.0 + 1.0j], sig=[1.0])
    else:
        path.write_bytes(content)
    with pytest.raises(CaseError, match=r"modes\.npz"):
        simulate(ideal(string={"measured": {"file": str(path)}}))


def test_a_finger_after_the_end_does_nothing():
    case = ideal(initial={"shape": "triangle", "position_m": 0.3, "displacement_m": 1e-3})
    plain = simulate(case).u
    for start in (5.0, 1e9):
        finger = {"position_m": 0.3, "displacement_m": 1e-3, "draw_s": 0.1, "start_s": start}
        np.testing.assert_array_equal(simulate({**case, "finger": [finger]}).u, plain)


@pytest.mark.parametrize(
    ("change", "overrides", "idle"),
    [
        ({}, {"restitution": 0.5}, "restitution is of no account to scheme exact-hold"),
        ({}, {"tail": "static", "scheme": "compliant"}, 'tail = "static" is of no account to scheme compliant'),
        ({}, {"tail": "lumped", "scheme": "event-driven"}, 'tail = "lumped" is of no account to scheme event-driven'),
        ({"scheme": {"start": "published"}}, {}, 'start = "published" is of no account'),
        ({"stiffness_n_m2": 1e6}, {"scheme": "exact-hold"}, "the wall's stiffness_n_m2 is of no account"),
        ({"stiffness_n_m2": 1e6}, {"restitution": 0.5}, None),
        ({}, {"tail": "lumped"}, None),
    ],
)
def test_what_is_given_and_not_used_is_said(change, overrides, idle):
    case = ideal(obstacle={"positions_m": [0.4], "heights_m": [-1e-3]})
    if "stiffness_n_m2" in change:
        case["obstacle"] = {"wall": {"from_m": 0.0, "to_m": 0.5, "height_m": -1e-3, **change}}
    else:
        case |= change
    told = []
    simulate(case, warn=told.append, **overrides)
    assert len(told) == (idle is not None) and all(idle in text for text in told)


def test_steps_that_were_not_solved_are_said():
    case = ideal(
        obstacle={"positions_m": [0.3], "heights_m": [0.0]},
        initial={"shape": "triangle", "position_m": 0.3, "displacement_m": 1e-3},
        scheme={"name": "compliant", "iterations": 1},
    )
    told = []
    summary = simulate(case, warn=told.append).summary
    assert summary["unsolved_steps"] > 0
    assert told == [f"{summary['unsolved_steps']} of 640 steps were not solved to tolerance; raise the internal rate"]


def test_a_pipe_is_written_to_and_stays(tmp_path):
    """What is no file, such as a device, is not replaced by one."""
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    simulate_file("tanpura", pipe, {"rate": 44_100, "modes": 5, "duration": 1e-3})
    reader.join()
    with np.load(io.BytesIO(got[0])) as saved:
        assert saved["u"].shape == (45, 1)
    assert pipe.is_fifo() and os.listdir(tmp_path) == ["pipe"]
    with pytest.raises(IsADirectoryError):
        simulate_file("tanpura", tmp_path, {"modes": 0})  # said before anything is computed


def test_an_obstacle_that_no_shape_clears_is_said():
    """One mode cannot lie over two points of which one is below its node's reach."""
    case = ideal(obstacle={"positions_m": [0.5], "heights_m": [1e-3]}, run={"modes": 1})
    assert simulate(case).summary["started_from_static_contact"]
    case = ideal(
        obstacle={"positions_m": [0.5], "heights_m": [1e-3]},
        initial={"shape": "modes", "q": [0.0]},
        scheme={"residual_compliance": False},
        run={"modes": 1},
    )
    assert simulate(case).summary["lifted_m"] == pytest.approx(1e-3)
