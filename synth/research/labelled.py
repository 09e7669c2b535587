"""Results as xarray Datasets: arrays by name with their dimensions, units and where they were taken. They need xarray.

Dimensions of one string: time [s], output and contact by their places [m from the nut], mode from 1. Of strings on a body
output and contact are numbered, as several strings have the same places; string and place stand beside them. `axis` names
the components of the bridge's motion. Attributes hold the rates and the scheme, and all of `metadata` as JSON, so that a
Dataset can be written to netCDF or Zarr as it is.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.files import notebook_html

if TYPE_CHECKING:
    import xarray

#: attributes of a Dataset, of those that metadata have and that are not None
_NAMED = ("version", "scheme", "restitution", "tail", "internal_rate_hz", "output_rate_hz", "modes", "duration_s")
_ENERGIES = {
    "energy_stored": "energy of the modes", "energy_residual": "energy of the modes left out and of what gives way",
    "energy_viscous": "lost to damping so far", "energy_contact": "lost at contacts so far",
    "energy_injected": "work done on the string so far",
}  # fmt: skip


def dataset_of(result: Any) -> xarray.Dataset:
    """What `Result.to_xarray` gives; arrays are shared, not copied. Raises ImportError without xarray."""
    variables: dict[str, tuple[Any, Any, dict[str, str]]] = {
        "u": (("time", "output"), result.u, _about("displacement", "m")),
        "u_contact": (("time", "contact"), result.u_contact, _about("displacement at the obstacle", "m")),
        "contact_force": (("time", "contact"), result.contact_force, _about("mean contact force since the row before", "N")),
    }
    for name, words in _ENERGIES.items():
        if (column := getattr(result, name)) is not None:
            variables[name] = ("time", column, _about(words, "J"))
    if result.obstacle_displacement is not None:
        variables["obstacle_displacement"] = (
            "time", result.obstacle_displacement, _about("obstacle above its heights at rest", "m"),
        )  # fmt: skip
    for name, unit in (("final_q", "m·√m"), ("final_v", "m·√m/s")):
        if (modes := getattr(result, name)) is not None:
            variables[name] = (
                "mode",
                modes,
                _about(f"modal {'displacement' if unit == 'm·√m' else 'velocity'} at the end", unit),
            )
    coordinates = {
        "time": ("time", result.t, _about("time", "s")),
        "output": ("output", result.positions, _about("place from the nut", "m")),
        "contact": ("contact", result.contact_positions, _about("place from the nut", "m")),
        "contact_height": ("contact", result.contact_heights, _about("height of the obstacle", "m")),
    }
    if result.final_q is not None:
        coordinates["mode"] = ("mode", np.arange(1, result.final_q.size + 1), _about("number of the mode", "1"))
    return _dataset(variables, coordinates, result)


def coupled_dataset_of(result: Any) -> xarray.Dataset:
    """What `CoupledResult.to_xarray` gives."""
    from synth.physics.body_modes import AXES
    from synth.solver.coupled_study import ENERGIES

    axes = list(AXES[: result.bridge.shape[1]])
    variables: dict[str, tuple[Any, Any, dict[str, str]]] = {
        "u": (("time", "output"), result.u, _about("displacement", "m")),
        "u_contact": (("time", "contact"), result.u_contact, _about("displacement at the contacts", "m")),
        "contact_force": (("time", "contact"), result.contact_force, _about("mean contact force since the row before", "N")),
        "bridge": (("time", "axis"), result.bridge, _about("motion of the bridge", "m, m, rad")),
        "bridge_force": (("time", "axis"), result.bridge_force, _about("mean force of the strings on it", "N, N, N m")),
        "radiated": (("time", "side"), result.radiated, _about("radiated", "m/s²")),
    }
    if result.energy is not None:
        variables["energy"] = (("time", "kind"), result.energy, _about("energy stored and lost so far", "J"))
    coordinates = {
        "time": ("time", result.t, _about("time", "s")),
        "output_position": ("output", result.positions, _about("place from the nut", "m")),
        "output_string": ("output", result.output_string, _about("string, from 0", "1")),
        "contact_position": ("contact", result.contact_positions, _about("place from the nut", "m")),
        "contact_string": ("contact", result.contact_string, _about("string, from 0", "1")),
        "contact_height": ("contact", result.contact_heights, _about("height of the obstacle", "m")),
        "axis": ("axis", axes, {}),
        "side": ("side", ["left", "right"], {}),
    }
    if result.energy is not None:
        coordinates["kind"] = ("kind", list(ENERGIES), {})
    return _dataset(variables, coordinates, result)


def _dataset(variables: dict[str, Any], coordinates: dict[str, Any], result: Any) -> xarray.Dataset:
    notebook_html.need("xarray", "to_xarray")
    import xarray

    about = result.metadata
    attributes = {name: about[name] for name in _NAMED if about.get(name) is not None}
    for name in ("largest_penetration_m", "largest_energy_rise", "last_contact_s"):
        attributes[name] = getattr(result, name)
    attributes["metadata"] = json.dumps(about)
    return xarray.Dataset(variables, coordinates, attributes)


def _about(name: str, unit: str) -> dict[str, str]:
    return {"long_name": name, "units": unit}
