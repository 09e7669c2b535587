"""The schemes by name, with a line on each; plain data, so that the command line can offer them at once."""

from __future__ import annotations

#: contact laws of the block kernels: what `render` and the engine can play
LAWS: dict[str, str] = {
    "exact-hold": "contact force held over the step, Signorini condition on positions at its end",
    "moreau-jean": "Moreau–Jean with Newton's impact law, as printed by Issanchou et al. 2018",
    "moreau-jean-filtered": "the same with filtered impulses and predicted gap, as the authors' program runs it",
}
#: exact solutions, each for the cases that have one
EXACT: dict[str, str] = {
    "waveguide": "ideal string over points: travelling waves, Δt = Δx/c",
    "cabannes": "ideal string, centred triangle over a point at mid-string: closed form",
    "flat-wall": "ideal string, triangle over an elastic flat wall: closed form",
    "event-driven": "any string over one point: every landing and release found exactly",
}
#: schemes of `simulate`
SCHEMES: dict[str, str] = {
    **LAWS,
    **EXACT,
}
