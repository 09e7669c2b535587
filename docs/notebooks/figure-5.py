# %% [markdown]
# # Figure 5: the obstacle, four times as closely
#
# Issanchou et al., JASA 143(5), 2018, section IV A. The paper's figure shows the displacement at the obstacle in (a) the first
# and (b) the second contact by Moreau–Jean, ϱ = 0 and ϱ = 1, at 2 MHz and at 8 MHz. It says: the rate does not change the global
# behaviour, but the local one; the penetration, "a numerical artifact linked to the time discretisation", shrinks with it; with
# ϱ = 1 there are small bounces after the string has reached the obstacle; with ϱ = 0 it sticks at "the height given by the first
# discrete point where contact condition is activated".
#
# How deep the string goes before a step sees it depends on where in that step it arrives: at most one step's motion, at least
# nothing. The last runs take other rates beside these, and four times each.
#
# Here the same four, every step of 10 ms at 2.1168 and 8.4672 MHz, and 4.2336 MHz between them.

# %%
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

import synth
from synth.dsp.measures import relative_error

MHZ = {48 * 44100: "2.1 MHz", 96 * 44100: "4.2 MHz", 192 * 44100: "8.5 MHz"}

# %%
runs = {
    (restitution, rate_hz): synth.simulate(
        "tanpura", scheme="moreau-jean", restitution=restitution, internal_rate_hz=rate_hz, output_rate_hz=rate_hz,
        duration_s=0.01,
    )
    for restitution in (0.0, 1.0)
    for rate_hz in MHZ
}  # fmt: skip


# %%
def depth_m(rate_hz: float) -> float:
    """How deep the first contact is, ϱ = 0."""
    run = synth.simulate(
        "tanpura", scheme="moreau-jean", restitution=0.0, internal_rate_hz=rate_hz, output_rate_hz=rate_hz, duration_s=0.0035
    )
    return float(-run.u_contact.min())


shallower = {factor: depth_m(factor * 44100) / depth_m(4 * factor * 44100) for factor in (40, 43, 46, 48, 50, 53, 56)}

# %%
styles = {(0.0, 48): "k--", (1.0, 48): "r-", (0.0, 192): "b--", (1.0, 192): "m-"}
figure, axes = plt.subplots(2, 1, figsize=(8, 5.5), layout="constrained")
for axis, (title, low, high) in zip(
    axes, (("(a) first contact", 1.26, 1.30), ("(b) second contact", 6.325, 6.365)), strict=True
):
    for (restitution, factor), style in styles.items():
        run = runs[restitution, factor * 44100]
        rows = (1e3 * run.t >= low) & (1e3 * run.t <= high)
        label = f"ϱ = {restitution:g}, {MHZ[factor * 44100]}"
        axis.plot(1e3 * run.t[rows], 1e6 * run.u_contact[rows, 0], style, lw=1, label=label)
    axis.axhline(0, color="gray", lw=0.5)
    axis.set(title=title, ylabel="u(6 mm), µm", ylim=(-0.4, 0.4))
    axis.margins(x=0)
axes[0].legend(fontsize="small", ncols=2)
axes[-1].set_xlabel("ms")
plt.show()

# %% [markdown]
# How deep the first contact is, by restitution and rate; whether the height at which ϱ = 0 sticks is that of the first step with
# a contact; and how far the runs are apart where one listens, at 0.992 m.


# %%
def first_contact(run) -> tuple[float, float]:
    """(height of the first row that is at or below the point, height 5 µs later) [m]."""
    height = run.u_contact[:, 0]
    at = int(np.argmax(height <= 0))
    return float(height[at]), float(height[at + round(5e-6 * run.metadata["internal_rate_hz"])])


deep = {key: float(-run.u_contact[1e3 * run.t < 3.5].min()) for key, run in runs.items()}
for (restitution, rate_hz), depth in deep.items():
    first, held = first_contact(runs[restitution, rate_hz])
    print(f"ϱ = {restitution:g}, {MHZ[rate_hz]}: {depth:.1e} m deep; first met at {first:.2e} m, held at {held:.2e} m")
slow, fast = 48 * 44100, 192 * 44100
apart = {
    restitution: relative_error(runs[restitution, slow].u[:, 0], runs[restitution, fast].u[::4, 0])
    for restitution in (0.0, 1.0)
}
for restitution, error in apart.items():
    print(f"ϱ = {restitution:g}: 2.1 against 8.5 MHz e = {error:.5f} at 0.992 m")

# %%
first, held = first_contact(runs[0.0, slow])
again = float(runs[0.0, slow].u_contact[round(2e-3 * slow), 0])
Markdown(f"""| | the paper | here |
| --- | --- | --- |
| four times the rate, seen from afar | "does not significantly change the global string behaviour" | e = {apart[0.0]:.4f} (ϱ = 0), {apart[1.0]:.4f} (ϱ = 1) over 10 ms at 0.992 m |
| penetration at 2 and 8 MHz | is reduced | {deep[1.0, slow]:.1e} → {deep[1.0, fast]:.1e} m |
| how many times less deep at four times the rate, from {min(shallower) * 0.0441:.2f} to {max(shallower) * 0.0441:.2f} MHz | – | {", ".join(f"{ratio:.1f}" for ratio in shallower.values())} |
| ϱ = 0 | sticks at the height of the first point in contact | first met at {first:.2e} m, 5 µs later at {held:.2e} m; it leaves for a moment 15 µs after the first touch and sticks again at {again:.2e} m |""")

# %%
assert deep[0.0, fast] < 0.5 * deep[0.0, slow] and deep[1.0, fast] < 0.5 * deep[1.0, slow]
assert max(apart.values()) < 0.01
assert min(shallower.values()) > 0.99 and max(shallower.values()) > 3.5
for rate_hz in MHZ:
    first, held = first_contact(runs[0.0, rate_hz])
    assert first < 0 and abs(held - first) < 1e-6 * abs(first), (rate_hz, first, held)
