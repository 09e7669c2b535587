"""What a run of strings on a body gave: held, shown in a line, written as .npz or as a table, and read again.

n rows, row 0 is t = 0; P points, C contacts, of all strings one after the other; D components of the bridge's motion.

    t (n,)                      [s]
    u (n, P)                    displacement at each string's outputs_m, along its direction [m]
    u_contact (n, C)            displacement at the contacts, with what residual compliance adds [m]; not over the bridge:
                                of what rides it is that against it
    contact_force (n, C)        mean since the row before [N]
    bridge (n, D)               its motion: normal [m], lateral [m], rocking [rad]
    bridge_force (n, D)         mean force of all strings on it since the row before [N, N, N m]
    radiated (n, 2)             Σ radiation · acceleration of the body's modes over the last step, left and right [m/s²]
    energy (n, 14)              with the ledger: columns `ENERGIES` [J], see `solver.coupled_study`. What is stored and lost,
                                less the work done, is what was stored in row 0
    output_string (P,), positions (P,), contact_string (C,), contact_positions (C,), contact_heights (C,)
    largest_penetration_m       over every step; beyond where an obstacle was then; negative: never touched
    largest_energy_rise         of one step or change of fret, over initial + injected energy; NaN without the ledger
    last_contact_s              NaN: none
    final (n,)                  state at the last row as `physics.coupled.CoupledStrings` lays it out, of open strings
                                (else zeros)
    metadata                    JSON text: version, scheme, rates, modes, duration_s, case (all tables), summary
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.files.npz import read_npz
from synth.research.citations import bibtex, sources_of
from synth.research.result import Recorded, ResultError, counted
from synth.solver.coupled_study import ENERGIES

if TYPE_CHECKING:
    import xarray

FORMAT = 1
KIND = "coupled"
_SCALARS = ("largest_penetration_m", "largest_energy_rise", "last_contact_s")
_UNITS = ("m", "m", "rad")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CoupledResult(Recorded):
    """The arrays that a run of strings on a body gave, made by `simulate` and `load_coupled_result`.

    n rows, of which row 0 is t = 0; P outputs and C contacts, of all strings one after the other; D components of the
    bridge's motion.

    Attributes
    ----------
    t : (n,) array
        Time [s].
    u : (n, P) array
        Displacement at each string's outputs_m, along its direction [m].
    u_contact : (n, C) array
        Displacement at the contacts, with what residual compliance adds [m]; of what rides the bridge: against it.
    contact_force : (n, C) array
        Mean force since the row before [N].
    bridge, bridge_force : (n, D) array
        Motion of the bridge, normal [m], lateral [m], rocking [rad], and the strings' mean force on it since the row before
        [N, N, N m].
    radiated : (n, 2) array
        Weighted acceleration of the body's modes over the last step, left and right [m/s²].
    energy : (n, 14) array or None
        With the ledger, the columns of `solver.coupled_study.ENERGIES` [J].
    output_string, positions : (P,) array
        Number of each output's string, from 0, and its place [m].
    contact_string, contact_positions, contact_heights : (C,) array
        Number of each contact's string, from 0, its place and height at t = 0 [m].
    largest_penetration_m, largest_energy_rise, last_contact_s : float
        As of a `Result`, over every step.
    final : (n,) array
        State at the last row as `physics.coupled.CoupledStrings` lays it out, of open strings (else zeros).
    metadata : dict
        Version, scheme, rates, modes, the case's tables and the summary; plain values, as JSON has them.

    References
    ----------
    Weinreich, Coupled piano strings, JASA 62(6), 1977.

    Examples
    --------
    >>> import synth
    >>> synth.simulate("guitar-pair", duration_s=0.001)
    <CoupledResult: exact-hold, 0 to 0.001 s in 49 rows, 3 outputs, 4 contacts of 2 strings at 48000 Hz>
    """

    u_contact: np.ndarray
    contact_force: np.ndarray
    bridge: np.ndarray
    bridge_force: np.ndarray
    radiated: np.ndarray
    energy: np.ndarray | None
    output_string: np.ndarray
    contact_string: np.ndarray
    final: np.ndarray

    def citation(self) -> str:
        """BibTeX of the program, at its present version, and of the papers whose methods the run used."""
        scheme, strings = self.metadata["scheme"], self.metadata["case"]["string"]
        slips = any(finger.get("slip_s") for string in strings for finger in string.get("finger", ()))
        return bibtex(scheme, sources_of(scheme, on_a_body=True, slips=slips))

    def __repr__(self) -> str:
        about = self.metadata
        ledger = "" if self.energy is None else ", ledger"
        return (
            f"<CoupledResult: {about['scheme']}, {self.t[0]:g} to {self.t[-1]:g} s in {counted(self.t.size, 'row')}, "
            f"{counted(self.positions.size, 'output')}, {counted(self.contact_positions.size, 'contact')} of "
            f"{counted(len(about['case']['string']), 'string')} at {about['internal_rate_hz']:g} Hz{ledger}>"
        )

    def _arrays(self) -> dict[str, Any]:
        return super()._arrays() | {"format": FORMAT, "kind": KIND}

    def table(self) -> dict[str, np.ndarray]:
        """The rows as columns (n,), by a name with the unit: t [s], u(1, 0.1 m) [m], bridge(normal) [m], …"""
        from synth.physics.body_modes import AXES

        columns = {"t [s]": self.t}
        names = [each.get("name") or str(k) for k, each in enumerate(self.metadata["case"]["string"], start=1)]
        for p, (string, x) in enumerate(zip(self.output_string, self.positions.tolist(), strict=True)):
            columns[f"u({names[string]}, {x!r} m) [m]"] = self.u[:, p]
        for name, unit in (("u_contact", "m"), ("contact_force", "N")):
            for c, (string, x) in enumerate(zip(self.contact_string, self.contact_positions.tolist(), strict=True)):
                columns[f"{name}({names[string]}, {x!r} m) [{unit}]"] = getattr(self, name)[:, c]
        for d, (axis, unit) in enumerate(zip(AXES, _UNITS, strict=True)):
            if d < self.bridge.shape[1]:
                columns[f"bridge({axis}) [{unit}]"] = self.bridge[:, d]
                columns[f"bridge_force({axis}) [{'N m' if unit == 'rad' else 'N'}]"] = self.bridge_force[:, d]
        for channel, side in enumerate(("left", "right")):
            columns[f"radiated({side}) [m/s²]"] = self.radiated[:, channel]
        if self.energy is not None:
            columns |= {f"energy({name}) [J]": self.energy[:, k] for k, name in enumerate(ENERGIES)}
        return columns

    def to_xarray(self) -> xarray.Dataset:
        """A Dataset of all arrays, which it shares, over time, output, contact, axis of the bridge and side, with units, the
        string and place of each, and what the run was as attributes (`metadata` as JSON). Raises ImportError without xarray.
        """
        from synth.research.labelled import coupled_dataset_of

        return coupled_dataset_of(self)


def load_coupled_result(path: str | os.PathLike[str]) -> CoupledResult:
    """Reads what `simulate` returned of strings on a body from its .npz, the same numbers to the bit.

    Parameters
    ----------
    path : str or path
        An .npz that `CoupledResult.save` or `synth simulate` wrote; those of one string are read by `load_result`.

    Returns
    -------
    CoupledResult
        With all fields.

    Raises
    ------
    ResultError
        For a file that is broken, foreign or of a newer version (a ValueError).
    OSError
        For a file that cannot be opened.

    Examples
    --------
    >>> import synth
    >>> synth.simulate("guitar-pair", duration_s=0.001).save("pair.npz")
    >>> synth.load_coupled_result("pair.npz").bridge.shape
    (49, 3)
    """
    try:
        found = read_npz(path)
    except ValueError as error:
        raise ResultError(str(error)) from None
    name = os.fspath(path)
    if str(found.get("kind", "")) != KIND:
        raise ResultError(f"{name}: is not a result of strings on a body; `synth.load_result` reads those of one string")
    version = found.get("format", np.array(0))
    if version.ndim or version.dtype.kind not in "iu" or int(version) > FORMAT:
        raise ResultError(f"{name}: format {version} is newer than {FORMAT}; install a newer version of this program")
    values: dict[str, Any] = {}
    for field in fields(CoupledResult):
        if field.name not in found:
            if field.name != "energy":
                raise ResultError(f"{name}: has no {field.name}")
            values["energy"] = None
        elif field.name == "metadata":
            values["metadata"] = _metadata(found["metadata"], name)
        elif field.name in _SCALARS:
            values[field.name] = float(_numbers(found[field.name], field.name, name, 0))
        else:
            values[field.name] = found[field.name]
    rows = _numbers(values["t"], "t", name, 1).size
    for key in ("u", "u_contact", "contact_force", "bridge", "bridge_force", "radiated", "energy"):
        if values[key] is not None and _numbers(values[key], key, name, 2).shape[0] != rows:
            raise ResultError(f"{name}: {key} has {values[key].shape[0]} rows, t has {rows}")
    return CoupledResult(**values)


def _numbers(array: np.ndarray, key: str, name: str, dimensions: int) -> np.ndarray:
    if array.dtype != np.float64 or array.ndim != dimensions:
        raise ResultError(f"{name}: {key} must be float64 of {dimensions} dimensions, got {array.dtype} of {array.shape}")
    return array


def _metadata(array: np.ndarray, name: str) -> dict[str, Any]:
    try:
        metadata = json.loads(str(array))
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{name}: metadata: {' '.join(str(error).split())}") from None
    for key, kind in {"scheme": str, "case": dict, "summary": dict, "internal_rate_hz": float | int}.items():
        if not isinstance(metadata, dict) or not isinstance(metadata.get(key), kind):
            raise ResultError(f"{name}: metadata: {key} is missing or wrong")
    return metadata
