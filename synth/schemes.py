"""The schemes by name, with a line on each; plain data, so that the command line can offer them at once."""

from __future__ import annotations

#: contact laws of the block kernels: what `render` and the engine can play
LAWS: dict[str, str] = {
    "exact-hold": "contact force held over the step, Signorini condition on positions at its end",
    "moreau-jean": "Moreau–Jean with Newton's impact law, as printed by Issanchou et al. 2018",
    "moreau-jean-filtered": "the same with filtered impulses and predicted gap, as the authors' program runs it",
}
#: compliant contacts, f = K [η − u]₊^α, on the exact modal two-step scheme
COMPLIANT: dict[str, str] = {
    "compliant": "power-law penalty by Newton–Raphson, energy kept (Issanchou et al. 2017)",
    "energy-quadratisation": "power-law penalty, one linear system a step (Ducceschi et al. 2021)",
    "scalar-auxiliary-variable": "power-law penalty, explicit (Bilbao, Ducceschi, Zama 2023)",
}
#: schemes of `simulate`
SCHEMES: dict[str, str] = {
    **LAWS,
    **COMPLIANT,
}
