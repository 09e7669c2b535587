"""Results in notebooks: drawn, shown, and as xarray Datasets that hold the same numbers."""

from __future__ import annotations

import json
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

import synth
from synth.files import notebook_html
from synth.research.result_pictures import PANELS, columns_of, thinned

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def run() -> synth.Result:
    found = synth.simulate("tanpura", quality="draft", duration_s=0.06, ledger=True, outputs_m=[0.5, 0.992])
    assert isinstance(found, synth.Result)
    return found


@pytest.fixture(scope="module")
def pair() -> synth.CoupledResult:
    found = synth.simulate("guitar-pair", duration_s=0.01, ledger=True)
    assert isinstance(found, synth.CoupledResult)
    return found


@pytest.fixture(autouse=True)
def closed() -> object:
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


def test_it_is_drawn(run: synth.Result) -> None:
    axes = run.plot()
    assert axes.shape == (3,)
    assert [axis.get_ylabel() for axis in axes] == ["displacement, mm", "contact force, N", "energy, mJ"]
    assert [line.get_label() for line in axes[0].lines] == ["500 mm", "992 mm"] and axes[2].get_xlabel() == "s"
    t, u = axes[0].lines[1].get_data()
    assert np.array_equal(t, run.t) and np.array_equal(u, 1e3 * run.u[:, 1])
    assert np.array_equal(axes[1].lines[0].get_ydata(), run.contact_force[:, 0])
    assert axes[2].lines[0].get_label() == "stored"
    assert np.array_equal(axes[2].lines[0].get_ydata(), 1e3 * run.energy_stored)


def test_panels_and_times(run: synth.Result) -> None:
    (axis,) = run.plot("u", start_s=0.01, end_s=0.02)
    t = axis.lines[0].get_xdata()
    assert axis.get_xlabel() == "ms" and t[0] == pytest.approx(10.0, abs=0.03) and t[-1] == pytest.approx(20.0, abs=0.03)
    assert len(run.plot(["energy", "u"])) == 2
    assert run.plot("u", axes=axis)[0] is axis and len(axis.lines) == 4
    bare = synth.simulate("tanpura", quality="draft", duration_s=0.06)
    assert len(bare.plot()) == 2
    for panels, words in ((["v"], "panels are of u, contact_force, energy, got 'v'"), ([], "must name at least one")):
        with pytest.raises(ValueError, match=words):
            run.plot(panels)
    with pytest.raises(ValueError, match="nothing to draw of energy: the run has none; simulate with ledger=True"):
        bare.plot("energy")
    with pytest.raises(ValueError, match=r"no rows from 1\.0 to None s: they go from 0 to 0\.06 s"):
        run.plot(start_s=1.0)
    with pytest.raises(ValueError, match="axes must be 3, one for each of u, contact_force, energy, got 1"):
        run.plot(axes=axis)


def test_lines_of_many_rows_keep_what_sticks_out() -> None:
    t = np.arange(100_000) / 44100
    x = np.sin(40 * t)
    x[54_321], x[77_777] = 3.0, -4.0
    few_t, few_x = thinned(t, x)
    assert few_x.size <= 4000 and few_x.max() == 3.0 and few_x.min() == -4.0
    assert few_t[few_x.argmax()] == t[54_321] and (np.diff(few_t) >= 0).all()
    assert thinned(t[:10], x[:10])[1] is not None and np.array_equal(thinned(t[:10], x[:10])[1], x[:10])


def test_strings_on_a_body(pair: synth.CoupledResult) -> None:
    axes = pair.plot()
    assert len(axes) == 3 and axes[0].lines[0].get_label() == "string 1, 150 mm"
    assert np.array_equal(axes[0].lines[2].get_ydata(), 1e3 * pair.u[:, 2])
    assert axes[2].lines and all(columns_of(pair, panel) for panel in PANELS)
    assert "<img" in pair._repr_html_() and "CoupledResult" in pair._repr_html_()


def test_places_that_two_share_have_lines_of_their_own(run: synth.Result) -> None:
    twice = replace(run, positions=np.array([0.5, 0.5]))
    assert list(columns_of(twice, "u")) == ["500 mm (1)", "500 mm (2)"]


def test_a_notebook_shows_it(run: synth.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    text = run._repr_html_()
    assert "Result: exact-hold, 0 to 0.06 s" in text and "largest_penetration_m" in text
    assert text.count("data:image/png;base64,iVBOR") == 1 and "http" not in text
    odd = replace(run, metadata={**run.metadata, "scheme": "<i>", "summary": {"what": None, "how": float("nan")}})
    assert "&lt;i&gt;" in odd._repr_html_() and "–" in odd._repr_html_()
    monkeypatch.setattr(notebook_html, "find_spec", lambda name: None)
    assert "<img" not in run._repr_html_() and "pip install &#x27;jawari[notebook]&#x27;" in run._repr_html_()
    with pytest.raises(ImportError, match=r"plot needs matplotlib: pip install 'jawari\[notebook\]'"):
        run.plot()
    with pytest.raises(ImportError, match=r"to_xarray needs xarray: pip install 'jawari\[notebook\]'"):
        run.to_xarray()


def test_a_dataset_has_all_arrays(run: synth.Result) -> None:
    data = run.to_xarray()
    assert dict(data.sizes) == {"time": run.t.size, "output": 2, "contact": 1, "mode": run.final_q.size}
    for name in data.data_vars:
        assert np.array_equal(data[name], getattr(run, name)), name
        assert data[name].attrs["units"] and data[name].attrs["long_name"]
    arrays = {name for name in synth.Result.__dataclass_fields__ if isinstance(getattr(run, name), np.ndarray)}
    assert set(data.data_vars) == arrays - {"t", "positions", "contact_positions", "contact_heights"}
    assert np.array_equal(data.u.sel(output=0.99, method="nearest"), run.u[:, 1])
    assert np.array_equal(data.time, run.t) and data.contact_height.dims == ("contact",) and data.mode[0] == 1
    assert np.shares_memory(data.u.values, run.u)
    assert data.attrs["scheme"] == "exact-hold" and "restitution" not in data.attrs
    assert json.loads(data.attrs["metadata"]) == json.loads(json.dumps(run.metadata))
    assert all(isinstance(value, str | float | int) for value in data.attrs.values())


def test_a_dataset_of_strings_on_a_body(pair: synth.CoupledResult) -> None:
    data = pair.to_xarray()
    for name in ("u", "u_contact", "contact_force", "bridge", "bridge_force", "radiated", "energy"):
        assert np.array_equal(data[name], getattr(pair, name)) and data[name].attrs["units"]
    assert data.axis.values.tolist() == ["normal", "lateral", "rocking"][: pair.bridge.shape[1]]
    assert np.array_equal(data.output_string, pair.output_string) and np.array_equal(data.output_position, pair.positions)
    assert "energy" not in replace(pair, energy=None).to_xarray() and len(replace(pair, energy=None).plot()) == 2


def test_it_is_written_and_read_again(run: synth.Result, tmp_path: object) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    data = run.to_xarray()
    data.to_zarr(f"{tmp_path}/run.zarr", consolidated=False)
    again = xarray.open_zarr(f"{tmp_path}/run.zarr", consolidated=False)
    xarray.testing.assert_identical(again.load(), data)
