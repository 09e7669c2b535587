"""The schemes by name, with a line on each; plain data, so that the command line can offer them at once."""

from __future__ import annotations

#: contact laws of the block kernels: what `render` and the engine can play
LAWS: dict[str, str] = {
    "exact-hold": "contact force held over the step, Signorini condition on positions at its end",
    "moreau-jean": "Moreau–Jean with Newton's impact law, as printed by Issanchou et al. 2018",
    "moreau-jean-filtered": "the same with filtered impulses and predicted gap, as the authors' program runs it",
}
#: schemes of `simulate`
SCHEMES: dict[str, str] = {
    **LAWS,
    "wall": "impulses at every node of the modal grid from an elastic, or rigid, wall along the string",
}
