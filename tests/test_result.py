"""Results: loaded as they were, gone on with, as tables; what a caller in Python sees of them."""

from __future__ import annotations

import csv
import inspect
import math
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import synth
from synth import cli
from synth.research.case import OVERRIDES
from synth.research.methods import nonsmooth_schemes
from synth.research.result import Result, ResultError, load_result
from synth.research.simulation import CaseError, Overrides, load_case, simulate, simulate_file
from synth.solver import driver, study

SMALL = {"rate": 88_200.0, "modes": 20, "duration_s": 0.005}
EVERY = {
    "exact-hold": ("tanpura", {"ledger": True}),
    "moreau-jean": ("tanpura", {}),
    "compliant": ("tanpura", {"ledger": True}),
    "energy-quadratisation": ("tanpura", {}),
    "scalar-auxiliary-variable": ("tanpura", {}),
    "event-driven": ("tanpura", {"ledger": True, "tail": "static"}),
}


def same(one: Result, other: Result) -> None:
    """Every field equal to the bit."""
    for field in fields(Result):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, dict) and field.name == "state":
            assert mine.keys() == theirs.keys()
            for name in mine:
                np.testing.assert_array_equal(mine[name], theirs[name], err_msg=name)
        elif isinstance(mine, np.ndarray):
            assert mine.dtype == theirs.dtype
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)
        else:
            assert mine == theirs or (math.isnan(mine) and math.isnan(theirs)), field.name


def joined(first: Result, second: Result, name: str) -> np.ndarray:
    return np.concatenate([getattr(first, name), getattr(second, name)[1:]])


def columns(result: Result) -> list[str]:
    names = ["t", "u", "u_contact", "contact_force", "energy_stored", "energy_residual", "energy_viscous", "energy_contact"]
    return [name for name in [*names, "energy_injected"] if getattr(result, name) is not None]


# --- files --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", EVERY)
def test_what_is_loaded_is_what_was_returned(scheme: str, tmp_path: Path) -> None:
    case, more = EVERY[scheme]
    result = simulate(case, scheme=scheme, **{**SMALL, **more})
    result.save(tmp_path / "out.npz")
    same(load_result(tmp_path / "out.npz"), result)
    assert os.listdir(tmp_path) == ["out.npz"]


def test_a_wall_and_a_formula_are_loaded_too(tmp_path: Path) -> None:
    """Contact rows that are made when first read, and a run that keeps no state."""
    for case, more in (("fretless", {"duration_s": 0.005}), ("cabannes", {"scheme": "cabannes", "duration_s": 0.002})):
        result = simulate(case, **more)
        result.save(tmp_path / "out.npz")
        same(load_result(tmp_path / "out.npz"), result)
    assert result.state is None and result.final_q is None


def test_files_that_hold_no_result(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    simulate("tanpura", **SMALL).save(path)
    with np.load(path) as data:
        good = dict(data)
    for change, message in (
        ({"metadata": None}, "x.npz: is not a result of simulate"),
        ({"u": None}, "has no u, but"),
        ({"format": np.array(99)}, "format 99 is newer than what this program reads, which is up to 1"),
        ({"format": np.array(-1)}, "format must be one whole number"),
        ({"u": good["u"][:-1]}, r"u has the shape \(220, 1\), which does not fit"),
        ({"u": good["u"].astype(np.float32)}, "u must be float64 of 2 dimensions, got float32"),
        ({"metadata": np.array("{}")}, "metadata: scheme is missing or wrong"),
        (
            {"metadata": np.array(str(good["metadata"]).replace('"end_step": 440', '"end_step": -3'))},
            "end_step -3 does not fit t",
        ),
        ({"metadata": np.array("{")}, "metadata: Expecting"),
        ({"final_q": good["final_q"][:3], "final_v": good["final_v"][:3]}, "final_q has 3 modes, the metadata say 20"),
        ({"state.q": np.array(["a"])}, r"state\.q must be numbers"),
    ):
        np.savez(path, **{name: array for name, array in {**good, **change}.items() if array is not None})
        with pytest.raises(ResultError, match=message):
            load_result(path)
    np.savez(path, noise=np.ones(3))
    with pytest.raises(ResultError, match="has no metadata and t, but noise"):
        load_result(path)
    path.write_bytes(b"[string]\n")
    with pytest.raises(ResultError, match=r"x\.npz cannot be read as \.npz"):
        load_result(path)
    with pytest.raises(ResultError, match="a table has not all of a result"):
        load_result(tmp_path / "x.csv")
    with pytest.raises(FileNotFoundError):
        load_result(tmp_path / "gone.npz")
    with pytest.raises(TypeError, match=r"loaded from the path of an \.npz file, got int 3"):
        load_result(3)  # type: ignore[arg-type]


def test_a_file_of_an_earlier_version_is_read_and_not_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "old.npz"
    simulate("tanpura", **SMALL).save(path)
    with np.load(path) as data:
        old = {name: data[name] for name in data.files if not name.startswith(("state.", "final_", "format"))}
    np.savez(path, **old)
    assert load_result(path).state is None
    with pytest.raises(CaseError, match="has kept nothing to go on from"):
        simulate("tanpura", resume_from=path, **SMALL)


def test_damaged_files_are_refused_or_harmless(tmp_path: Path) -> None:
    """Bytes changed, cut off and put in: one line that names the file, or a result."""
    path = tmp_path / "x.npz"
    simulate("tanpura", rate=88_200.0, modes=3, duration_s=1e-4).save(path)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    for _ in range(400):
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 4))):
            place = int(rng.integers(len(data)))
            match int(rng.integers(3)):
                case 0:
                    data[place] = int(rng.integers(256))
                case 1:
                    del data[place:]
                case _:
                    data[place:place] = rng.bytes(3)
            if not data:
                break
        path.write_bytes(bytes(data))
        try:
            load_result(path)
        except ResultError as error:
            refused += 1
            assert "x.npz" in str(error) and "\n" not in str(error)
    assert refused > 300


def test_a_table_has_every_row_to_the_bit(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    case = {**load_case("hard/moving-ramp").model_dump(exclude_none=True)}
    result = simulate(case, ledger=True, duration_s=0.003)
    result.save(path)
    with open(path, encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    x, c = result.positions[0], result.contact_positions[0]
    assert head[:3] == ["t [s]", f"u({float(x)!r} m) [m]", f"u_contact({float(c)!r} m) [m]"]
    assert head[-6:] == ["obstacle_displacement [m]", *(f"energy_{name} [J]" for name in study.ENERGY_COLUMNS)]
    found = np.array(rows, dtype=float)
    assert found.shape == (result.t.size, len(head))
    np.testing.assert_array_equal(found[:, 0], result.t)
    np.testing.assert_array_equal(found[:, 1], result.u[:, 0])
    np.testing.assert_array_equal(found[:, -1], result.energy_injected)
    assert os.listdir(tmp_path) == ["t.csv"]


def test_other_endings_are_refused_before_anything_is_computed(tmp_path: Path, capsys) -> None:
    with pytest.raises(
        ValueError, match=r"t\.wav: results are written as \.npz \(everything\) or \.csv \(a table\), got '\.wav'"
    ):
        simulate_file("tanpura", tmp_path / "t.wav", {"modes": 0})  # type: ignore[typeddict-item]
    assert cli.main(["simulate", "tanpura", "-o", str(tmp_path / "tanpura.toml")]) == 2
    assert "got '.toml'" in capsys.readouterr().err
    arguments = ["simulate", "tanpura", "--rate", "44100", "--modes", "5", "--duration", "0.001", "--quiet", "-o"]
    for name in ("t", "t.csv", "t.NPZ"):
        assert cli.main([*arguments, str(tmp_path / name)]) == 0
    assert (tmp_path / "t.csv").read_text().startswith("t [s],")
    assert load_result(tmp_path / "t").t.size == load_result(tmp_path / "t.NPZ").t.size == 45


# --- going on -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "seconds", "more"),
    [
        ("tanpura", 1760 / 88_200, {}),  # whole blocks of eight steps
        ("tanpura", 1760 / 88_200, {"substeps": 2}),
        ("tanpura", 0.0131, {"ledger": True}),  # a step at a time
        ("tanpura", 1761 / 88_200, {"scheme": "moreau-jean", "output_rate": 88_200.0}),  # the first step is one of its own
        ("tanpura", 0.0131, {"scheme": "moreau-jean-filtered", "restitution": 0.5, "output_rate": 11_025.0}),
        ("bass", 0.01, {"output_rate": 11_025.0}),  # rows are whole blocks apart
        ("tanpura", 0.0051, {"scheme": "compliant"}),
        ("bass", 0.0101, {"scheme": "compliant", "ledger": True}),
        ("tanpura", 0.0051, {"scheme": "energy-quadratisation"}),
        ("bass", 0.0101, {"scheme": "scalar-auxiliary-variable"}),
        ("hard/moving-ramp", 0.011, {}),
        ("hard/bend", 0.033, {"modes": None}),
        ("hard/repluck", 0.011, {}),
    ],
)
def test_twice_as_long_is_once_and_gone_on_with(case: str, seconds: float, more: Overrides) -> None:
    common: Overrides = {"rate": 88_200.0, "modes": 40, **more}  # type: ignore[typeddict-item]
    if case.startswith("hard"):
        common = {}
    whole = simulate(case, duration_s=2.0 * seconds, **common)
    first = simulate(case, duration_s=seconds, **common)
    second = simulate(case, duration_s=seconds, resume_from=first, **common)
    for name in columns(whole):
        together = joined(first, second, name)
        assert abs(together.shape[0] - whole.t.size) <= 1
        np.testing.assert_array_equal(together, getattr(whole, name)[: together.shape[0]], err_msg=name)
    assert second.metadata["start"] == "resumed" and second.summary["resumed_at_s"] == first.t[-1]
    assert np.any(whole.contact_force[first.t.size :] != 0.0)
    if second.t[-1] == whole.t[-1]:
        np.testing.assert_array_equal(second.final_q, whole.final_q)
        np.testing.assert_array_equal(second.final_v, whole.final_v)


@pytest.mark.parametrize(
    ("case", "more", "rounding"),
    [
        ("tanpura", {"rate": 88_200.0, "modes": 40, "duration_s": 0.02}, 1e-12),  # the last steps are less than a block
        ("fretless", {"duration_s": 0.01, "ledger": True}, 1e-10),  # flights are divided otherwise
        ("tanpura", {"scheme": "event-driven", "tail": "static", "rate": 88_200.0, "modes": 20, "duration_s": 0.01}, 1e-8),
        ("ideal-bridge", {"scheme": "waveguide", "duration_s": 0.01}, 1e-15),
    ],
)
def test_or_the_same_to_rounding(case: str, more: Overrides, rounding: float) -> None:
    if case == "ideal-bridge":
        case = {**load_case(case).model_dump(exclude_none=True)}  # type: ignore[assignment]
    seconds = more["duration_s"]
    assert seconds is not None
    whole = simulate(case, **{**more, "duration_s": 2.0 * seconds})  # type: ignore[typeddict-item]
    first = simulate(case, **more)
    second = simulate(case, resume_from=first, **more)
    for name in columns(whole):
        together, all_of_it = joined(first, second, name), getattr(whole, name)
        scale = np.abs(all_of_it).max()
        np.testing.assert_allclose(together, all_of_it, rtol=0, atol=max(rounding, 1e3 * (name != "u") * rounding) * scale)


def test_a_finger_that_holds_the_string_at_the_end_goes_on_holding() -> None:
    case = load_case("tanpura").model_dump(exclude_none=True) | {
        "finger": [
            {"position_m": 0.3, "displacement_m": 1e-3, "start_s": 0.002, "draw_s": 0.006, "hold_s": 0.001},
            {"position_m": 0.5, "displacement_m": -1e-3, "start_s": 0.012, "draw_s": 0.004},
        ]
    }
    common: Overrides = {"rate": 88_200.0, "modes": 40}
    whole = simulate(case, duration_s=0.02, **common)
    parts = [simulate(case, duration_s=0.005, **common)]
    for _ in range(3):
        parts.append(simulate(case, duration_s=0.005, resume_from=parts[-1], **common))
    together = np.concatenate([parts[0].u, *(part.u[1:] for part in parts[1:])])
    np.testing.assert_allclose(together, whole.u[: together.size], rtol=0, atol=1e-13 * np.abs(whole.u).max())
    later = {**case["finger"][1], "displacement_m": 2e-3}
    other = simulate(case | {"finger": [case["finger"][0], later]}, duration_s=0.005, resume_from=parts[1], **common)
    assert other.t[0] == parts[1].t[-1]  # what has not begun may be another
    with pytest.raises(CaseError, match=r"resume_from: finger was .* there, is \[\] here"):
        simulate(case | {"finger": []}, resume_from=parts[1], duration_s=0.005, **common)


def test_what_cannot_go_on_says_why() -> None:
    first = simulate("tanpura", **SMALL)
    tables = load_case("tanpura").model_dump(exclude_none=True)
    for case, more, message in (
        (
            {**tables, "string": {**tables["string"], "tension_n": 100.0}},
            {},
            r"string\.tension_n was 180\.5 there, is 100\.0 here",
        ),
        ("tanpura", {"modes": 21}, r"run\.modes was 20 there, is 21 here; a run goes on only as it was; to start another"),
        ("tanpura", {"scheme": "compliant"}, r"scheme\.name was 'exact-hold' there, is 'compliant' here"),
        (
            {**tables, "bend": [{"start_s": 0.006, "duration_s": 0.01, "cents": 10.0}]},
            {},
            r"scheme\.tail was 'lumped' there",
        ),
        ("cabannes", {}, "string"),
    ):
        with pytest.raises(CaseError, match=message):
            simulate(case, resume_from=first, **{**SMALL, **more})
    formula = simulate("cabannes", scheme="cabannes", duration_s=0.002)
    with pytest.raises(CaseError, match="'cabannes' has kept nothing to go on from; run it for the whole time"):
        simulate("cabannes", scheme="cabannes", duration_s=0.002, resume_from=formula)
    assert first.state is not None
    for name, array, message in (
        ("q", first.state["q"][:-1], r"state\.q must have the shape \(\d+,\), got \(\d+,\)"),
        ("force", None, r"state\.force is missing"),
        ("v", first.state["v"] * np.nan, "not finite"),
        ("omega", first.state["omega"] * 1.01, "the string's modes were others there"),
        ("fingers", np.array(7), r"state\.fingers"),
        ("sums", np.ones(3), r"state\.sums must have the shape"),
    ):
        state = {key: value for key, value in {**first.state, name: array}.items() if value is not None}
        broken = Result(**{f.name: getattr(first, f.name) for f in fields(Result)} | {"state": state})
        with pytest.raises(CaseError, match=message):
            simulate("tanpura", resume_from=broken, **{**SMALL, "ledger": name == "sums"})


def test_from_another_file_on_the_command_line(tmp_path: Path, capsys) -> None:
    one, two = str(tmp_path / "one.npz"), str(tmp_path / "two.npz")
    arguments = ["simulate", "tanpura", "--rate", "44100", "--modes", "20", "--duration", "0.01", "--quiet"]
    assert cli.main([*arguments, "-o", one]) == 0
    assert cli.main([*arguments, "-o", two, "--from", one]) == 0
    again = simulate("tanpura", rate=44_100.0, modes=20, duration_s=0.01, resume_from=one)
    np.testing.assert_array_equal(load_result(two).u, again.u)
    assert load_result(two).t[0] == load_result(one).t[-1]
    before = Path(one).read_bytes()
    assert cli.main([*arguments, "-o", one, "--from", one]) == 2
    assert "would overwrite --from" in capsys.readouterr().err
    assert Path(one).read_bytes() == before
    assert cli.main([*arguments, "-o", two, "--from", str(tmp_path / "gone.npz")]) == 2
    assert "gone.npz" in capsys.readouterr().err


def test_the_last_shape_starts_another_run(tmp_path: Path) -> None:
    first = simulate("tanpura", **SMALL)
    first.save(tmp_path / "one.npz")
    case = load_case("tanpura").model_dump(exclude_none=True)
    case["initial"] = {"shape": "modes", "file": str(tmp_path / "one.npz"), "q": "final_q", "v": "final_v"}
    other = simulate(case, **{**SMALL, "tail": "none", "modes": 30})
    assert other.u[0, 0] == pytest.approx(first.u[-1, 0], rel=0.2) and other.t[0] == 0.0


# --- time ---------------------------------------------------------------------------------------------------------------


def test_time_to_compile_is_not_time_to_compute(monkeypatch) -> None:
    """A first call that takes 100 s by the clock, as one that compiles does, later ones 1 s."""
    clock, calls, run = [0.0], [], driver.run

    def slow(*arguments) -> None:
        clock[0] += 1.0 if calls else 100.0
        calls.append(arguments)
        run(*arguments)

    monkeypatch.setattr(driver, "run", slow)
    monkeypatch.setattr(nonsmooth_schemes.time, "perf_counter", lambda: clock[0])
    summary = simulate("tanpura", **SMALL).summary
    assert len(calls) >= 2 and 0.0 < summary["compute_s"] < 50.0
    assert summary["compile_s"] >= 0.0


# --- names --------------------------------------------------------------------------------------------------------------


def test_the_package_shows_its_names() -> None:
    assert {"simulate", "load_result", "Result", "Engine", "load_preset", "CaseError"} <= set(dir(synth))
    for name in synth.__all__:
        assert getattr(synth, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        synth.simulat  # type: ignore[attr-defined]  # noqa: B018
    assert (Path(synth.__file__).parent / "py.typed").is_file()


def test_overrides_are_typed_as_they_are_read() -> None:
    assert set(Overrides.__annotations__) == {*OVERRIDES, "quality"}
    shown = inspect.signature(simulate).parameters
    assert {"case", "resume_from", "warn", "settings", *Overrides.__annotations__} == set(shown)


@pytest.mark.parametrize("case", [[1], 3, None, b"tanpura", {1}])
def test_what_is_no_case_is_a_type_error_that_says_what_is(case) -> None:
    with pytest.raises(TypeError, match=r"a case is the path of a \.toml file, .* got (list|int|NoneType|bytes|set) "):
        simulate(case)
    for wrong in ({"warn": 3}, {"resume_from": case}) if case is not None else ():
        with pytest.raises(TypeError, match=r"warn is|resume_from is"):
            simulate("tanpura", **wrong)


def test_a_wrong_name_names_the_nearest() -> None:
    with pytest.raises(CaseError, match="no override 'durations' \\(perhaps duration_s\\?\\)"):
        simulate("tanpura", durations=3)  # type: ignore[call-arg]


def test_what_is_shown_is_a_line() -> None:
    result = simulate("bass", rate=88_200.0, modes=20, duration_s=0.01, ledger=True)
    assert repr(result) == (
        "<Result: exact-hold, 0 to 0.01 s in 442 rows, 1 output, 20 contacts, 20 modes at 88200 Hz, ledger>"
    )
    preset = synth.load_preset("tanpura")
    assert repr(preset) == str(preset) == "<Preset tanpura: 4 strings, C2–C3, obstacle bridge>"
    for shown in (result, load_case("bass"), load_case("fretless"), *synth.list_presets(), load_case("hard/one-mode")):
        assert len(repr(shown)) < 130 and "\n" not in repr(shown)


PROGRAM = """
import numpy as np
import synth

result = synth.simulate("tanpura", duration_s=0.1, modes=50, quality=None)
reveal_type(result)
reveal_type(result.u)
again: synth.Result = synth.load_result("out.npz")
reveal_type(synth.simulate("tanpura", resume_from=again).summary)
reveal_type(synth.load_preset("tanpura"))
synth.simulate("tanpura", durations=3)
synth.simulate("tanpura", modes="many")
synth.simulate([1])
"""


def test_a_type_checker_sees_the_package(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    root = Path(synth.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", str(root / "pyproject.toml"), str(program)],
        cwd=root, capture_output=True, text=True,
    )  # fmt: skip
    said = [line.partition("program.py:")[2] for line in done.stdout.splitlines() if "program.py:" in line]
    notes = [line for line in said if "Revealed type" in line]
    for line, kind in zip(
        notes, ("synth.research.result.Result", "ndarray", "dict[", "synth.instrument.preset.Preset"), strict=True
    ):
        assert kind in line
    errors = [line for line in said if " error: " in line]
    assert [int(line.partition(":")[0]) for line in errors] == [11, 12, 13], done.stdout
    assert 'did you mean "duration' in errors[0] and '"modes"' in errors[1] and "list[int]" in errors[2]
