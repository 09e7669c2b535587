"""What a run of `synth.simulate` gave: held, shown in a line, written as .npz or as a table, and read again.

The .npz has every field of `Result` under its name, what a run is gone on with as state.NAME, the metadata as JSON text and
`format`, which says how all that is to be read. Files of version 0.5 and before have no format and no state.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from synth.files.npz import read_npz
from synth.files.targets import is_special, write_whole
from synth.research.citations import bibtex, sources_of
from synth.research.result_pictures import Drawn

if TYPE_CHECKING:
    import xarray

FORMAT = 1
_STATE = "state."
_ENERGIES = ("energy_stored", "energy_residual", "energy_viscous", "energy_contact", "energy_injected")
#: shapes by field: n rows, P outputs, C contacts, N modes
_SHAPES: dict[str, str] = {
    "t": "n", "u": "nP", "u_contact": "nC", "contact_force": "nC", **dict.fromkeys(_ENERGIES, "n"),
    "positions": "P", "contact_positions": "C", "contact_heights": "C", "obstacle_displacement": "n",
    "largest_penetration_m": "", "largest_energy_rise": "", "last_contact_s": "", "final_q": "N", "final_v": "N",
}  # fmt: skip
_OPTIONAL = {*_ENERGIES, "obstacle_displacement", "final_q", "final_v"}
_SCALARS = {name for name, shape in _SHAPES.items() if not shape}


class ResultError(ValueError):
    """A file that holds no result, or one that cannot be read; the message names it. A ValueError.

    Examples
    --------
    >>> import synth
    >>> try:
    ...     synth.load_result("run.csv")
    ... except synth.ResultError as error:
    ...     print(error)
    run.csv: a table has not all of a result; load the .npz
    """


class LazyField:
    """A field of a dataclass: an array, or what makes it when it is first read."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Any, owner: type | None = None) -> np.ndarray:
        if instance is None:
            raise AttributeError(self.name)  # so that the field has no default
        value = instance.__dict__[self.name]
        if callable(value):
            value = instance.__dict__[self.name] = value()
        return value

    def __set__(self, instance: Any, value: np.ndarray | Callable[[], np.ndarray]) -> None:
        instance.__dict__[self.name] = value


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Recorded(Drawn):
    """What results of every kind hold, each as `Result` says, and how it is written."""

    t: np.ndarray
    u: np.ndarray
    positions: np.ndarray
    contact_positions: np.ndarray
    contact_heights: np.ndarray
    largest_penetration_m: float
    largest_energy_rise: float
    last_contact_s: float
    metadata: dict[str, Any]

    @property
    def summary(self) -> dict[str, Any]:
        """The few numbers that `synth simulate` prints."""
        return self.metadata["summary"]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all of it as .npz, or the rows as a table if the name ends in .csv.

        Whole or not at all: first beside `path` under another name, then renamed. A device or a pipe is written to as it
        is. Raises ValueError for another ending, OSError.
        """
        check_name(path)
        if is_table(path):
            write_whole(path, lambda file: write_columns(self.table(), file))
        else:
            write_whole(path, lambda file: np.savez(file, **self._arrays()))

    def _arrays(self) -> dict[str, Any]:
        """What the .npz has, by name."""
        arrays = {each.name: value for each in fields(self) if (value := getattr(self, each.name)) is not None}
        return arrays | {"format": FORMAT, "metadata": json.dumps(self.metadata)}

    def table(self) -> dict[str, np.ndarray]:
        """The rows as columns (n,), by a name with the unit."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result(Recorded):
    """The arrays that a run of one string gave, made by `simulate` and `load_result`.

    n rows, of which row 0 is t = 0; P outputs, C contacts, N modes.

    Attributes
    ----------
    t : (n,) array
        Time [s].
    u : (n, P) array
        Displacement at the case's outputs_m, up is positive [m].
    u_contact : (n, C) array
        Displacement at the obstacle's points, with what residual compliance adds [m].
    contact_force : (n, C) array
        Mean force since the row before [N]; row 0: the static one, or that of the row gone on from.
    energy_stored, energy_residual, energy_viscous, energy_contact, energy_injected : (n,) array or None
        With the ledger [J]: of the modes, of the modes left out, lost so far to damping and at contacts, work done on the
        string so far. stored + residual + viscous + contact = stored(0) + residual(0) + injected.
    positions : (P,) array
        The outputs_m, from the nut [m].
    contact_positions, contact_heights : (C,) array
        The obstacle at t = 0 [m].
    obstacle_displacement : (n,) array or None
        Of an obstacle that moves, how far it is above `contact_heights` [m].
    largest_penetration_m : float
        Over every step with the ledger, over the rows without [m]; negative: never touched.
    largest_energy_rise : float
        Of one step, over initial + injected energy; NaN without the ledger.
    last_contact_s : float
        End of the last step with a contact force [s]; NaN: none.
    final_q, final_v : (N,) array or None
        Modes at the last row [m·√m], [m·√m/s]; None of closed forms and waves.
    state : dict or None
        What `simulate(…, resume_from=…)` goes on from, the scheme's own arrays by name.
    metadata : dict
        Version, scheme, rates, modes, the case's tables and the summary; plain values, as JSON has them.

    Examples
    --------
    >>> import synth
    >>> run = synth.simulate("tanpura", quality="draft", duration_s=0.01, ledger=True)
    >>> run
    <Result: exact-hold, 0 to 0.01 s in 442 rows, 1 output, 1 contact, 179 modes at 88200 Hz, ledger>
    >>> run.largest_penetration_m < 1e-12 and run.largest_energy_rise < 1e-12
    True
    """

    u_contact: LazyField = LazyField()
    contact_force: LazyField = LazyField()
    energy_stored: np.ndarray | None
    energy_residual: np.ndarray | None
    energy_viscous: np.ndarray | None
    energy_contact: np.ndarray | None
    energy_injected: np.ndarray | None
    obstacle_displacement: np.ndarray | None
    final_q: np.ndarray | None
    final_v: np.ndarray | None
    state: dict[str, np.ndarray] | None

    def citation(self) -> str:
        """BibTeX of the program, at its present version, and of the papers whose methods the run used."""
        scheme, fingers = self.metadata["scheme"], self.metadata["case"].get("finger", ())
        return bibtex(scheme, sources_of(scheme, slips=any(finger.get("slip_s") for finger in fingers)))

    def __repr__(self) -> str:
        about, (rows, outputs), contacts = self.metadata, self.u.shape, self.contact_positions.size
        ledger = "" if self.energy_stored is None else ", ledger"
        return (
            f"<Result: {about['scheme']}, {self.t[0]:g} to {self.t[-1]:g} s in {rows} rows, "
            f"{counted(outputs, 'output')}, {counted(contacts, 'contact')}, {counted(about['modes'], 'mode')} at "
            f"{about['internal_rate_hz']:g} Hz{ledger}>"
        )

    def _arrays(self) -> dict[str, Any]:
        arrays = super()._arrays()
        state = arrays.pop("state", {})
        return arrays | {_STATE + name: array for name, array in state.items()}

    def table(self) -> dict[str, np.ndarray]:
        """The rows as columns (n,), by a name with the unit: t [s], u(0.992 m) [m], contact_force(0.006 m) [N], …"""
        columns = {"t [s]": self.t}
        columns |= {f"u({x!r} m) [m]": self.u[:, p] for p, x in enumerate(self.positions.tolist())}
        for name, unit in (("u_contact", "m"), ("contact_force", "N")):
            rows = getattr(self, name)
            columns |= {f"{name}({x!r} m) [{unit}]": rows[:, c] for c, x in enumerate(self.contact_positions.tolist())}
        for name in ("obstacle_displacement", *_ENERGIES):
            if (column := getattr(self, name)) is not None:
                columns[f"{name} [{'m' if name == 'obstacle_displacement' else 'J'}]"] = column
        return columns

    def to_xarray(self) -> xarray.Dataset:
        """A Dataset of all arrays, which it shares, over time, output, contact and mode, with units and what the run was as
        attributes (`metadata` as JSON); `.sel(output=0.992, method="nearest")`. Of scheme "wall" this has made what
        was yet to be made. Raises ImportError without xarray.
        """
        from synth.research.labelled import dataset_of

        return dataset_of(self)


def write_columns(columns: dict[str, np.ndarray], file: BinaryIO) -> None:
    """Columns (n,) by their names as a table of comma-separated values."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
    try:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(_rows(list(columns.values())))
    finally:
        text.detach()


def _rows(columns: list[np.ndarray], at_once: int = 4096) -> Iterator[tuple[float, ...]]:
    """Row by row as floats, whose text is the shortest that is read back as the same number."""
    for start in range(0, columns[0].size, at_once):
        yield from zip(*(column[start : start + at_once].tolist() for column in columns), strict=True)


def counted(count: int, what: str) -> str:
    """ "1 row", "2 rows"."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def is_table(path: str | os.PathLike[str]) -> bool:
    """Whether a result of this name is written as a table."""
    return Path(path).suffix.lower() == ".csv"


def check_name(path: str | os.PathLike[str]) -> None:
    """ValueError where no result can be written under this name: to be asked before it is computed."""
    suffix = Path(path).suffix
    if suffix.lower() not in ("", ".npz", ".csv") and not is_special(path):
        raise ValueError(f"{os.fspath(path)}: results are written as .npz (everything) or .csv (a table), got {suffix!r}")


def load_result(path: str | os.PathLike[str]) -> Result:
    """Reads what `simulate` returned from the .npz that `Result.save` or `synth simulate` wrote: the same numbers to the
    bit.

    Parameters
    ----------
    path : str or path
        An .npz of one string; those of strings on a body are read by `load_coupled_result`.

    Returns
    -------
    Result
        With all fields, `state` too: a run can go on from it.

    Raises
    ------
    ResultError
        For a file that is broken, foreign or of a newer version (a ValueError).
    OSError
        For a file that cannot be opened.
    TypeError
        For what is no path.

    Examples
    --------
    >>> import synth
    >>> run = synth.simulate("tanpura", quality="draft", duration_s=0.01)
    >>> run.save("run.npz")
    >>> again = synth.load_result("run.npz")
    >>> bool((again.u == run.u).all())
    True
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"a result is loaded from the path of an .npz file, got {_shown(path)}")
    if is_table(path):
        raise ResultError(f"{os.fspath(path)}: a table has not all of a result; load the .npz")
    try:
        found = read_npz(path)
        return _result_of(found)
    except ResultError as error:
        raise ResultError(f"{os.fspath(path)}: {error}") from None
    except ValueError as error:
        raise ResultError(str(error)) from None


def _result_of(found: dict[str, np.ndarray]) -> Result:
    """The result that arrays by name make; ResultError, which names no file."""
    if str(found.get("kind", "")) == "coupled":
        raise ResultError("is of strings on a body; `synth.load_coupled_result` reads it")
    if "metadata" not in found or "t" not in found:
        raise ResultError(f"is not a result of simulate: has no metadata and t, but {_few(found)}")
    version = _whole(found.get("format", np.array(0)), "format")
    if version > FORMAT:
        raise ResultError(
            f"format {version} is newer than what this program reads, which is up to {FORMAT}: install a newer version of it"
        )
    metadata = _metadata(found["metadata"], version)
    sizes: dict[str, int] = {}
    values: dict[str, Any] = {}
    for name, shape in _SHAPES.items():
        if name not in found and name not in _OPTIONAL:
            raise ResultError(f"is not a result of simulate: has no {name}, but {_few(found)}")
        array = found.get(name)
        values[name] = array
        if array is None:
            continue
        if array.dtype != np.float64 or array.ndim != len(shape):
            raise ResultError(f"{name} must be float64 of {len(shape)} dimensions, got {array.dtype} of shape {array.shape}")
        for letter, size in zip(shape, array.shape, strict=True):
            if sizes.setdefault(letter, size) != size:
                raise ResultError(f"{name} has the shape {array.shape}, which does not fit the arrays before it")
        if name in _SCALARS:
            values[name] = float(array)
    if not sizes["n"]:
        raise ResultError("t has no rows")
    if sizes.get("N", metadata["modes"]) != metadata["modes"]:
        raise ResultError(f"final_q has {sizes['N']} modes, the metadata say {metadata['modes']}")
    end = metadata["internal_rate_hz"] * float(values["t"][-1])
    if version and not (0 <= metadata["end_step"] < 2**53 and abs(metadata["end_step"] - end) <= 1e-6 * (1.0 + abs(end))):
        raise ResultError(f"metadata: end_step {metadata['end_step']} does not fit t, which ends at step {end:.6g}")
    state = {name.removeprefix(_STATE): array for name, array in found.items() if name.startswith(_STATE)}
    for name, array in state.items():
        if array.dtype.kind not in "iuf":
            raise ResultError(f"{_STATE}{name} must be numbers, got {array.dtype}")
    return Result(**values, state=state or None, metadata=metadata)


def _metadata(array: np.ndarray, version: int) -> dict[str, Any]:
    try:
        if array.ndim or array.dtype.kind != "U":
            raise ValueError(f"must be text, got {array.dtype} of shape {array.shape}")
        metadata = json.loads(str(array))
    except (ValueError, RecursionError) as error:
        raise ResultError(f"metadata: {' '.join(str(error).split())}") from None
    wanted: dict[str, Any] = {
        "scheme": str, "modes": int, "internal_rate_hz": float | int, "case": dict, "summary": dict,
        **({"end_step": int} if version else {}),
    }  # fmt: skip
    for key, kind in wanted.items():
        value = metadata.get(key) if isinstance(metadata, dict) else None
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ResultError(f"metadata: {key} is missing or wrong, got {_shown(value)}")
    return metadata


def _whole(array: np.ndarray, name: str) -> int:
    if array.ndim or array.dtype.kind not in "iu" or not 0 <= int(array) < 2**31:
        raise ResultError(f"{name} must be one whole number, got {_shown(array.tolist())}")
    return int(array)


def _few(found: dict[str, np.ndarray]) -> str:
    names = sorted(found)
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "") if names else "nothing"


def _shown(value: Any) -> str:
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '…'}"
