"""`synth body fit`: known bodies are found again in their noisy mobilities, and what is no measurement is refused."""

import json
import math
import tomllib

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from synth.cli import main
from synth.fit.body_fit import MobilityRefused, fit_body
from synth.fit.mobility import Mobility, read_mobility
from synth.fit.modal_least_squares import Modes, Rows, jacobian_of, packed, residual_of, unpacked
from synth.fit.vector_fitting import common_poles
from synth.instrument.preset import MovingMode
from synth.physics.body_modes import Body, BodyMode
from tests.oracles import three_strings


def measured(body: Body, frequency_hz: np.ndarray, noise: float, seed: int = 0, pairs=None) -> Mobility:
    """Its mobility with noise of so many parts of each component's median."""
    rng, y = np.random.default_rng(seed), body.mobility(2 * math.pi * frequency_hz)
    pairs = pairs or [(i, j) for i in range(1, body.axes + 1) for j in range(i, body.axes + 1)]
    components = {}
    for i, j in pairs:
        clean = y[:, i - 1, j - 1]
        size = noise * np.median(np.abs(clean)) / math.sqrt(2)
        components[i, j] = clean + size * (rng.normal(size=clean.size) + 1j * rng.normal(size=clean.size))
    return Mobility(frequency_hz, components)


def decibels_off(found: Body, body: Body, frequency_hz: np.ndarray, i: int = 0, j: int = 0) -> np.ndarray:
    omega = 2 * math.pi * frequency_hz
    return np.abs(20 * np.log10(np.abs(found.mobility(omega)[:, i, j] / body.mobility(omega)[:, i, j])))


#: rows half the narrowest mode's width apart
GRID = np.linspace(50.0, 1500.0, 700)
#: so many that neighbours are averaged
FINE = np.linspace(50.0, 1500.0, 2000)


def test_poles_of_a_noiseless_body_are_found_exactly():
    body, grid = three_strings.body(2), np.linspace(50.0, 1500.0, 600)
    y = body.mobility(2 * math.pi * grid)
    responses = np.array([y[:, 0, 0], y[:, 0, 1], y[:, 1, 1]])
    found = common_poles(2 * math.pi * grid, responses, 1 / np.abs(responses), 12, 20)
    exact = -body.sigma + 1j * np.sqrt(body.omega**2 - body.sigma**2)
    assert np.allclose(found, exact, rtol=1e-7)


def test_slopes_of_the_least_squares_are_those_of_its_residual():
    rng = np.random.default_rng(1)
    y = rng.normal(size=(3, 40)) + 1j * rng.normal(size=(3, 40))
    data = Rows(2 * math.pi * np.linspace(80, 500, 40), y, 1 / np.abs(y), [(0, 0), (0, 1), (1, 1)], (1, 2))
    inside = np.array([False, False, False, True, True])
    free = np.array([[1, 1], [1, 1], [1, 1], [1, 1], [0, 1]], bool)
    modes = Modes(
        2 * math.pi * rng.uniform(80, 500, 5), rng.uniform(0.01, 0.1, 5), rng.normal(size=(5, 2)) * free, free, inside
    )
    x, exact = packed(modes), jacobian_of(data, modes)
    for k in range(x.size):
        step = 1e-6 * np.eye(x.size)[k]
        slope = (residual_of(data, unpacked(x + step, modes)) - residual_of(data, unpacked(x - step, modes))) / 2e-6
        assert np.abs(slope - exact[:, k]).max() < 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize(("axes", "grid"), [(1, GRID), (2, FINE)], ids=["normal", "both axes, averaged"])
@pytest.mark.parametrize(("noise", "median_db", "worst_db"), [(0.01, 0.02, 0.2), (0.1, 0.2, 2.0)])
def test_a_guitar_is_found_again_within_its_noise(axes, grid, noise, median_db, worst_db):
    body = three_strings.body(axes)
    fit = fit_body(measured(body, grid, noise))
    off = decibels_off(fit.body, body, grid)
    assert np.median(off) < median_db and off.max() < worst_db
    assert len(fit.modes) >= 12
    for mode in body.modes:
        near = min(fit.modes, key=lambda found: abs(found.frequency_hz - mode.frequency_hz))
        assert near.frequency_hz == pytest.approx(mode.frequency_hz, rel=0.1 * noise)
        assert near.q == pytest.approx(mode.q, rel=2 * noise + 0.02)
        # the shape's length is a convention: what counts is ψψᵀ/m
        assert near.shape[0] ** 2 / near.mass_kg == pytest.approx(mode.shape[0] ** 2 / mode.mass_kg, rel=2 * noise + 0.02)


def test_what_a_fit_tells_of_itself_is_what_it_is_off_by():
    body = three_strings.body(1)
    fit = fit_body(measured(body, FINE, 0.0))
    off, told = decibels_off(fit.body, body, FINE), fit.errors[1, 1]
    assert told.worst_db == pytest.approx(off.max(), abs=1e-9) and told.median_db == pytest.approx(np.median(off), abs=1e-9)
    assert 1e-4 < off.max() and fit.explained > 0.999999


def test_linear_algebra_has_one_thread(monkeypatch):
    """Threads for matrices this small keep all cores busy for several times the work."""
    seen = []

    def poles(*arguments):
        seen.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return common_poles(*arguments)

    monkeypatch.setattr("synth.fit.body_fit.common_poles", poles)
    with threadpool_limits(limits=2, user_api="blas"):
        fit_body(measured(three_strings.body(1), GRID, 0.01), modes=12)
    assert seen and set(seen) == {1}


def test_three_axes_and_shapes_with_their_signs():
    body = three_strings.body(3)
    fit = fit_body(measured(body, GRID, 0.01))
    found = fit.body.mobility(2 * math.pi * GRID)
    assert found.shape[1:] == (3, 3)
    for i in range(3):
        for j in range(3):
            assert np.median(decibels_off(fit.body, body, GRID, i, j)) < 0.1
    strongest = max(fit.modes, key=lambda mode: mode.q / mode.mass_kg / mode.frequency_hz)
    true = min(body.modes, key=lambda mode: abs(mode.frequency_hz - strongest.frequency_hz))
    assert np.allclose(np.array(strongest.shape) / strongest.shape[0], np.array(true.shape) / true.shape[0], atol=0.05)
    # sign of the lateral part from Y12 alone, Y22 not being measured
    fit = fit_body(measured(three_strings.body(2), GRID, 0.01, pairs=[(1, 1), (1, 2)]))
    assert np.median(decibels_off(fit.body, three_strings.body(2), GRID, 0, 1)) < 0.1


def test_overlapping_modes():
    """Two modes within a bandwidth of each other, a third near: the mobility is found, to whomever the parts are given."""
    body = Body(
        (BodyMode(200.0, 12.0, 0.2), BodyMode(212.0, 15.0, 0.3), BodyMode(245.0, 20.0, 0.25), BodyMode(600.0, 30.0, 0.4))
    )
    grid = np.linspace(80.0, 1000.0, 1500)
    fit = fit_body(measured(body, grid, 0.01), modes=4)
    assert len(fit.modes) <= 4
    assert decibels_off(fit.body, body, grid).max() < 0.3


def test_what_lies_outside_the_band_is_a_mass_and_a_stiffness():
    body = three_strings.body(1)
    grid = np.linspace(150.0, 520.0, 900)
    fit = fit_body(measured(body, FINE, 0.0), (150.0, 520.0))
    assert fit.band_hz[0] >= 150.0 and fit.band_hz[1] <= 520.0
    assert fit.outside and all(not 150.0 < mode.frequency_hz < 520.0 for mode in fit.outside)
    assert np.median(decibels_off(fit.body, body, grid)) < 0.1
    assert decibels_off(fit.body, body, grid).max() < 1.0


def test_axes_that_do_not_meet():
    """Y12 = 0 exactly, as of a body that is symmetric: modes move normally or laterally, not both."""
    body = Body(
        (
            BodyMode(110.0, 20.0, 0.4, (1.0, 0.0)),
            BodyMode(170.0, 30.0, 0.9, (0.0, 1.0)),
            BodyMode(320.0, 25.0, 0.5, (1.0, 0.0)),
        )
    )
    grid = np.linspace(60.0, 500.0, 800)
    fit = fit_body(measured(body, grid, 0.001))
    assert len(fit.modes) == 3
    assert decibels_off(fit.body, body, grid).max() < 0.1 and decibels_off(fit.body, body, grid, 1, 1).max() < 0.1
    assert sorted(round(abs(mode.shape[0]), 2) for mode in fit.modes) == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e4])
def test_bodies_much_heavier_or_lighter_are_written_as_a_preset_may_have_them(size):
    """Mass and shape share what is one number to the strings, ψψᵀ/m."""
    body = Body((BodyMode(110.0, 20.0, 0.4 / size, (1.0, 0.0, 40.0)), BodyMode(320.0, 25.0, 0.5 / size, (0.01, 0.02, 30.0))))
    grid = np.linspace(60.0, 500.0, 600)
    fit = fit_body(measured(body, grid, 0.001))
    assert decibels_off(fit.body, body, grid, 2, 2).max() < 0.1
    for mode in fit.body.modes:
        MovingMode(frequency_hz=mode.frequency_hz, q=mode.q, mass_kg=mode.mass_kg, shape=mode.shape)


@pytest.mark.slow
def test_every_fit_is_passive_however_bad():
    omega = 2 * math.pi * np.geomspace(1.0, 50000.0, 2000)
    for seed in range(4):
        fit = fit_body(measured(three_strings.body(3), GRID, 0.3, seed), modes=10 + seed)
        assert np.linalg.eigvalsh(fit.body.mobility(omega).real).min() >= -1e-12 * np.abs(fit.body.mobility(omega)).max()
        assert len(fit.modes) <= 10 + seed


@pytest.mark.parametrize("modes", [None, 5])
def test_noise_alone_is_refused(modes):
    rng = np.random.default_rng(4)
    noise = 1e-3 * (rng.normal(size=GRID.size) + 1j * rng.normal(size=GRID.size))
    # its mean real part is positive, as that of a body
    with pytest.raises(MobilityRefused, match=r"no modes stand out of the noise .* check coherence"):
        fit_body(Mobility(GRID, {(1, 1): noise + 1e-4}), modes=modes)


def test_a_turned_sign_is_refused():
    good = measured(three_strings.body(1), GRID, 0.0)
    with pytest.raises(
        MobilityRefused, match=r"real part of y11 must be positive, .* got negative in 100 % of the band; reverse the"
    ):
        fit_body(Mobility(GRID, {(1, 1): -good.components[1, 1]}))


# --- the table --------------------------------------------------------------------------------------------------------


def written(path, mobility: Mobility, header: str, columns) -> str:
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns(mobility), strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return str(path)


def parts(mobility: Mobility):
    return [mobility.frequency_hz] + [part for y in mobility.components.values() for part in (y.real, y.imag)]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("frequency_hz,y11_re,y11_im", parts),
        ("Frequency [Hz],Re(Y11) [m/s/N],Im(Y11) [m/s/N]", parts),
        ("f (kHz),Y11 real [mm/s/N],y11 imag (mm/s/N)", lambda m: [m.frequency_hz / 1e3, *(1e3 * x for x in parts(m)[1:])]),
        (
            "frequency_hz,y11_db,y11_phase_deg",
            lambda m: [m.frequency_hz, 20 * np.log10(np.abs(m.components[1, 1])), np.degrees(np.angle(m.components[1, 1]))],
        ),
        (
            "f_hz,y11_abs,y11_phase_rad,coherence",
            lambda m: [
                m.frequency_hz,
                np.abs(m.components[1, 1]),
                np.angle(m.components[1, 1]),
                np.ones(m.frequency_hz.size),
            ],
        ),
    ],
)
def test_a_table_is_read_whatever_its_form(tmp_path, header, columns):
    true = measured(three_strings.body(1), np.linspace(50.0, 1500.0, 100), 0.0)
    path = written(tmp_path / "m.csv", true, header, columns)
    found = read_mobility(path)
    assert np.allclose(found.frequency_hz, true.frequency_hz, rtol=1e-8)
    assert np.allclose(found.components[1, 1], true.components[1, 1], rtol=1e-7)
    assert found.ignored == (("coherence",) if "coherence" in header else ())


def test_semicolons_tabs_comments_blank_lines_a_mark_and_a_row_of_zero_hertz(tmp_path):
    true = measured(three_strings.body(2), np.linspace(0.0, 500.0, 60), 0.0)
    text = "# of a guitar\n\nfrequency_hz,y11_re,y11_im,y21_re,y21_im,y22_re,y22_im\n"
    text += "\n".join(",".join(f"{value:.9g}" for value in row) for row in zip(*parts(true), strict=True)) + "\n"
    for name, mark in (("a", ","), ("b", ";"), ("c", "\t")):
        path = tmp_path / f"{name}.csv"
        path.write_bytes(b"\xef\xbb\xbf" + text.replace(",", mark).replace("\n", "\r\n").encode())
        found = read_mobility(path)
        assert found.frequency_hz.size == 59 and found.axes == (1, 2)
        assert np.allclose(found.components[1, 2], true.components[1, 2][1:], rtol=1e-7)


ROWS = "\n".join(f"{50 + k},{1e-3 + 1e-5 * k},{1e-4}" for k in range(40))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "m.csv: is empty"),
        ("frequency_hz,y11_re,y11_im\n" + ROWS[:100], "must hold at least 24 rows, got 5; give the whole measurement"),
        ("frequency_hz,y11_re\n", "row 1 must name y11_re and y11_im, or y11_db .* got re of y11"),
        ("hertz,y11_re,y11_im\n" + ROWS, "row 1 must name a column 'frequency_hz'"),
        ("frequency_hz,z_re,z_im\n" + ROWS, "row 1 must name columns of y11"),
        ("frequency,y11_re,y11_im\n" + ROWS, r"row 1, column 1 \(frequency\) must have the unit hz or khz, got ''"),
        ("frequency_hz,y11_re,y11_im,y22_re,y22_im\n", "row 1 must name y12 too, which tells the sign"),
        ("frequency_hz,y11_re,y11_im,y21_re,y12_re\n", r"row 1, column 5 \(y12_re\) is there twice"),
        ("frequency_hz,y11_re,y11_im,y14_re\n", r"column 4 \(y14_re\) must be of axes 1"),
        ("frequency_hz,y11_re,y11_imaginary\n" + ROWS, r"column 3 \(y11_imaginary\) must have the unit|must be named like"),
        ("frequency_hz,y11_re [furlong],y11_im\n" + ROWS, r"column 2 .* must have the unit m/s/n or .*, got 'furlong'"),
        ("frequency_hz,y11_db,y11_phase\n" + ROWS, r"column 3 \(y11_phase\) must have the unit deg"),
        (
            "# 1\nfrequency_hz,y11_re,y11_im\n" + ROWS.replace("60,", "sixty,", 1),
            r"row 13, column 1 \(frequency_hz\) .* got 'sixty'",
        ),
        (
            "frequency_hz,y11_re,y11_im\n" + ROWS.replace("0.0001", "nan", 1),
            r"row 2, column 3 \(y11_im\) .* finite number, got 'nan'",
        ),
        (
            "frequency_hz,y11_re,y11_im\n" + ROWS.replace("60,", "40,", 1),
            "row 12, column 1 .* must rise .* got 40 Hz after 59 Hz",
        ),
        ("frequency_hz,y11_re,y11_im\n-1,1,1\n" + ROWS, "row 2, column 1 .* got -1 Hz; sort"),
        ("frequency_hz,y11_re,y11_im\n" + ROWS + "\n1,2\n", "row 42 must have 3 columns as the header, got 2"),
        ("frequency_hz;y11_re;y11_im\n" + ROWS.replace(",", ";").replace(".", ","), "write decimals with a point"),
        ("frequency_hz,y11_re,y11_im\n" + "\n".join(f"{k},0,0" for k in range(40)), "y11 is silent, at most 0 m/s/N"),
        ("frequency_hz,y11_re,y11_im\n" + ROWS.replace("0.0001", "1e9", 1), "row 2: y11 must be at most 1e.06 m/s/N"),
        ("frequency_hz,y11_db,y11_phase_deg\n" + ROWS.replace("0.001,", "1e7,", 1), "row 2: y11 must be at most"),
        ("frequency_khz,y11_re,y11_im\n" + ROWS.replace("50,", "50e9,", 1), "must rise from 0 Hz"),
        ("frequency_khz,y11_re,y11_im\n" + ROWS.replace("89,", "89e9,"), "must lie between 0.01 and 1e.06 Hz .* check the"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "row 1 is no text in UTF-8"),
    ],
)
def test_a_broken_table_is_told_by_file_row_and_column(tmp_path, capsys, text, message):
    path = tmp_path / "m.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=message) as refused:
        read_mobility(path)
    assert str(refused.value).startswith(str(path))
    # and by the command, in one line
    assert main(["body", "fit", str(path), "-o", str(tmp_path / "out.toml")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("synth: error: ") and error.count("\n") == 1
    assert not (tmp_path / "out.toml").exists()


# --- the command ------------------------------------------------------------------------------------------------------

HEADER = "frequency_hz,y11_re,y11_im,y12_re,y12_im,y22_re,y22_im"


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> str:
    grid = np.linspace(50.0, 1000.0, 600)
    return written(
        tmp_path_factory.mktemp("body") / "guitar.csv", measured(three_strings.body(2), grid, 0.01), HEADER, parts
    )


def test_the_tables_are_modes_of_a_body(table, capsys, tmp_path):
    assert main(["body", "fit", table]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"# fitted to {json.dumps(table)}\n# ")
    assert "off by 0.0" in text and "# shape: normal, lateral, rocking" in text
    tables = tomllib.loads(text)["body"]["mode"]
    body = Body(tuple(BodyMode(**mode) for mode in tables))
    assert all(MovingMode(**mode).mass_kg == mode["mass_kg"] for mode in tables)  # and of a preset's
    grid = np.linspace(60.0, 950.0, 500)
    assert np.median(decibels_off(body, three_strings.body(2), grid)) < 0.05
    # to a file, with a report instead
    out = tmp_path / "body.toml"
    assert main(["body", "fit", table, "-o", str(out)]) == 0
    report = capsys.readouterr().out
    assert f"{table}: y11: off by" in report and report.endswith(f"written: {out}\n")
    assert tomllib.loads(out.read_text(encoding="utf-8"))["body"]["mode"] == tables
    assert main(["body", "fit", table, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    modes = sorted((*told["modes"], *told["outside_band"]), key=lambda mode: mode["frequency_hz"])
    assert modes == tables
    assert told["band_hz"] == [50.0, 1000.0] and told["rows"] == 600
    assert told["deviations_db"]["y11"]["median"] < 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--band", "1200", "1300"],
            "a band from 1200 to 1300 Hz must hold at least 24 rows, got 0 of 600 from 50 to 1000 Hz",
        ),
        (["--band", "100", "200", "--modes", "40"], "modes must be at most a quarter of the 63 rows, got 40; widen"),
        (["--band", "500", "100"], "band must rise from 20 Hz or above to at most 10000 Hz, got 500 to 100 Hz"),
        (["-o", "IN"], "would overwrite mobility"),
        (["-o", "/nowhere/at/all.toml"], "there is no directory /nowhere/at"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(table, capsys, arguments, message):
    assert main(["body", "fit", table, *[table if word == "IN" else word for word in arguments]]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


@pytest.mark.parametrize("arguments", [["--modes", "0"], ["--modes", "many"], ["--band", "10"], ["--band", "a", "b"]])
def test_wrong_options_are_usage_errors(table, arguments):
    with pytest.raises(SystemExit) as ended:
        main(["body", "fit", table, *arguments])
    assert ended.value.code == 2


def test_a_hundred_thousand_rows(tmp_path):
    """A sweep at 0.05 Hz from row to row: averaged, and still the same body."""
    body = three_strings.body(1)
    grid = np.linspace(20.0, 5020.0, 100_000)
    path = written(tmp_path / "long.csv", measured(body, grid, 0.1), "frequency_hz,y11_re,y11_im", parts)
    fit = fit_body(read_mobility(path), (60.0, 1500.0))
    assert fit.rows == np.count_nonzero((grid >= 60.0) & (grid <= 1500.0))
    assert np.median(decibels_off(fit.body, body, GRID[20:])) < 0.1
