# %% [markdown]
# # Figure 4: at the obstacle itself
#
# Issanchou et al., JASA 143(5), 2018, section IV A. The paper's figure shows the displacement at the obstacle, with zooms on the
# first two contacts, by the penalty and by Moreau–Jean with ϱ = 0 and ϱ = 1, at 2 MHz. It says: with ϱ = 0 the string sticks and
# leaves when the wave comes back, "around 3.8e-3 s for the first contact time, then around 8.8e-3 s for the second"; with ϱ = 1
# it bounces "with a magnitude of about 1e-7 m", in oscillations of one time step; the penalty's oscillations are smoother and of
# similar size, and there is a very small penetration.
#
# Here the same three and exact-hold, every step of 12 ms at 2.1168 MHz.

# %%
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

import synth

rate_hz = 48 * 44100
same = {"internal_rate_hz": rate_hz, "output_rate_hz": rate_hz, "duration_s": 0.012}

# %%
runs = {
    "penalty": synth.simulate("tanpura", scheme="compliant", stiffness=1e10, exponent=1.5, **same),
    "Moreau–Jean, ϱ = 0": synth.simulate("tanpura", scheme="moreau-jean", restitution=0.0, **same),
    "Moreau–Jean, ϱ = 1": synth.simulate("tanpura", scheme="moreau-jean", restitution=1.0, **same),
    "exact-hold": synth.simulate("tanpura", scheme="exact-hold", **same),
}
ms = 1e3 * runs["penalty"].t

# %%
styles = {"penalty": "g-", "Moreau–Jean, ϱ = 1": "r-", "Moreau–Jean, ϱ = 0": "k--", "exact-hold": "b:"}
figure, axes = plt.subplots(3, 1, figsize=(8, 7), layout="constrained")
windows = ((0.0, 12.0), (1.255, 1.30), (3.74, 3.83))
for axis, (low, high) in zip(axes, windows, strict=True):
    rows = (ms >= low) & (ms <= high)
    for name, style in styles.items():
        axis.plot(ms[rows], 1e6 * runs[name].u_contact[rows, 0], style, lw=1, label=name)
    axis.set_ylabel("u(6 mm), µm")
    axis.margins(x=0)
for axis in axes[1:]:
    axis.set_ylim(-0.5, 0.5)
figure.legend(*axes[0].get_legend_handles_labels(), fontsize="small", ncols=4, loc="outside upper center")
axes[-1].set_xlabel("ms")
plt.show()

# %% [markdown]
# Above: three periods. In the middle: the string comes down on the point. Below: it is lifted off when the wave comes back.
# When it leaves is when the last force of a contact ends.


# %%
def contact_ends_ms(run) -> list[float]:
    """When the string leaves the point for a while: ends of forces with 0.5 ms of rest behind them [ms]."""
    pressed = ms[run.contact_force[:, 0] > 0]
    return [float(at) for at in pressed[:-1][np.diff(pressed) > 0.5]]


held = (ms > 1.6) & (ms < 3.6)
leaves = {name: contact_ends_ms(run) for name, run in runs.items()}
swing = {name: float(np.ptp(run.u_contact[held, 0])) for name, run in runs.items()}
deepest = {name: float(-run.u_contact.min()) for name, run in runs.items()}
for name in runs:
    ends = ", ".join(f"{at:.2f}" for at in leaves[name][:2])
    print(
        f"{name:20} leaves at {ends} ms; moves by {swing[name]:.1e} m while it is held; {deepest[name]:.1e} m deep at most"
    )

# %%
red, black, green = (names for names in ("Moreau–Jean, ϱ = 1", "Moreau–Jean, ϱ = 0", "penalty"))
Markdown(f"""| | the paper | here |
| --- | --- | --- |
| the string leaves the point, ϱ = 0 | 3.8 ms, 8.8 ms | {leaves[black][0]:.2f} ms, {leaves[black][1]:.2f} ms |
| ϱ = 0 while it is held | sticks | moves by {swing[black]:.0e} m |
| ϱ = 1 | bounces of about 1e-7 m | moves by {swing[red]:.1e} m, peak to peak |
| penalty | smoother, similar amplitude | moves by {swing[green]:.1e} m, peak to peak |
| penetration | very small | Moreau–Jean {deepest[red]:.1e} m, penalty {deepest[green]:.1e} m, exact-hold {max(deepest["exact-hold"], 0.0):.0e} m |""")

# %%
for name, each in leaves.items():
    assert abs(each[0] - 3.8) < 0.05 and abs(each[1] - 8.8) < 0.15, (name, each)
assert swing[black] < 1e-9 and 3e-8 < swing[red] < 1e-6 and 3e-8 < swing[green] < 1e-6
assert 0 < deepest[red] < 1e-6 and 0 < deepest[green] < 1e-6 and deepest["exact-hold"] < 1e-15
