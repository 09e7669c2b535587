# %% [markdown]
# # Table III: what a second costs
#
# Issanchou et al., JASA 143(5), 2018, section IV A. The paper's table III has computation times for one second of the tanpura's
# string with 1001 modes, in MATLAB on one processor of 2.4 GHz: for the penalty with the full grid in S, the penalty with the
# contact alone, and Moreau–Jean. It says: the contact alone is a factor of 2 cheaper than the full grid, and Moreau–Jean 12 to 37
# times cheaper than the penalty.
#
# Seconds of another machine and another language compare badly; what compares is how the rows stand to one another, and how they
# grow with the rate. Here the same three, with the kernels of this program, each over a short piece of the same motion.
# `tools/speed-error` has the whole table in CPU seconds, with repeats.

# %%
import os

import matplotlib.pyplot as plt
from IPython.display import Markdown

import synth

SHORT = os.environ.get("JAWARI_NOTEBOOK") == "short"
#: seconds, by the multiple of 44.1 kHz (44.1, 88.2, 176, 1000 kHz in the paper; 24 is 1058.4 kHz)
PAPER = {
    "penalty, full grid": {1: 205, 2: 407, 4: 815, 24: 4326},
    "penalty, contact alone": {1: 108, 2: 208, 4: 372, 24: 1732},
    "Moreau–Jean": {1: 7.1, 2: 16, 4: 22, 24: 142},
}
SETTINGS = {
    "penalty, full grid": {"scheme": "compliant", "stiffness": 1e10, "grid": "full"},
    "penalty, contact alone": {"scheme": "compliant", "stiffness": 1e10},
    "Moreau–Jean": {"scheme": "moreau-jean", "restitution": 1.0},
}


# %%
def seconds_a_second(name: str, factor: int) -> float:
    """Computing time of the steps alone for a second of sound, the best of three."""
    steps = 200 if SHORT else 2000 if name == "penalty, full grid" else 40_000
    duration_s = steps / (factor * 44100)
    given = {"internal_rate_hz": factor * 44100, "output_rate_hz": factor * 44100, "modes": 1001, "duration_s": duration_s}
    runs = [synth.simulate("tanpura", **SETTINGS[name], **given) for _ in range(1 if SHORT else 3)]
    assert all(run.summary["steps"] == steps and run.summary["modes"] == 1001 and run.summary["finite"] for run in runs)
    return min(run.summary["compute_s"] for run in runs) / duration_s


for name in SETTINGS:
    seconds_a_second(name, 1)  # whatever is compiled or read first
here = {name: {factor: seconds_a_second(name, factor) for factor in row} for name, row in PAPER.items()}

# %%
figure, axis = plt.subplots(figsize=(9, 4), layout="constrained")
for (name, row), colour in zip(PAPER.items(), ("tab:green", "tab:olive", "tab:red"), strict=True):
    khz = [44.1 * factor for factor in row]
    axis.loglog(khz, list(row.values()), "o--", color=colour, mfc="none", label=f"{name}, the paper's MATLAB")
    axis.loglog(khz, list(here[name].values()), "s-", color=colour, label=f"{name}, here")
axis.set(xlabel="internal rate, kHz", ylabel="s for 1 s of sound")
figure.legend(fontsize="small", ncols=3, loc="outside upper center")
plt.show()

# %% [markdown]
# Moreau–Jean is taken as 1, at each rate: so many times longer take the others.


# %%
def times(table: dict, name: str, factor: int) -> float:
    return table[name][factor] / table["Moreau–Jean"][factor]


lines = ["| against Moreau–Jean at the same rate | the paper | here |", "| --- | --- | --- |"]
for name in ("penalty, full grid", "penalty, contact alone"):
    for factor in PAPER[name]:
        lines.append(
            f"| {name}, {44.1 * factor:.4g} kHz | {times(PAPER, name, factor):.0f} × | {times(here, name, factor):.{0 if times(here, name, factor) > 10 else 1}f} × |"
        )
lines.append("| **growth from 44.1 kHz to 1 MHz (24 times the steps)** | | |")
for name in PAPER:
    lines.append(f"| {name} | {PAPER[name][24] / PAPER[name][1]:.0f} × | {here[name][24] / here[name][1]:.0f} × |")
lines.append("| **seconds for a second at 1 MHz** (another machine, another language) | | |")
for name in PAPER:
    lines.append(f"| {name} | {PAPER[name][24]} s | {here[name][24]:.{0 if here[name][24] > 10 else 2}f} s |")
Markdown("\n".join(lines))

# %%
ratios = [times(PAPER, name, factor) for name in ("penalty, full grid", "penalty, contact alone") for factor in PAPER[name]]
assert 12 <= round(min(ratios)) and round(max(ratios)) <= 37  # as the paper's text has them
assert all(value > 0 for row in here.values() for value in row.values())
