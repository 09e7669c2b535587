# %% [markdown]
# # Figure 6: the neck of the bass
#
# Issanchou et al., JASA 143(5), 2018, section IV B. The paper's figure shows the profile g of an electric bass's neck with its 20
# frets under the G string at rest, and the string as it is drawn aside: 64 cm from the nut, 3.6 mm.
#
# Here the same from the case `bass`, whose fret heights are the paper's instrument's. They follow its figure and the data
# published with it; between the frets the board lies a centimetre lower and is never touched, so that it is left out.

# %%
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

import synth

case = synth.load_case("bass")
frets_m, heights_m = np.array(case.obstacle.positions_m), np.array(case.obstacle.heights_m)
start = synth.simulate(
    "bass", duration_s=1 / 44100, outputs_m=np.linspace(0.001, 0.862, 500), internal_rate_hz=44100, modes=863
)

# %%
figure, axis = plt.subplots(figsize=(8, 3), layout="constrained")
axis.plot(start.positions, 1e3 * start.u[0], label="string, drawn aside")
axis.plot(frets_m, 1e3 * heights_m, "k.", label="frets")
axis.vlines(frets_m, -10, 1e3 * heights_m, color="k", lw=0.5)
axis.axhline(0, lw=0.5, color="gray")
axis.set(xlabel="from the nut, m", ylabel="mm", ylim=(-4, 4))
axis.legend()
plt.show()

# %% [markdown]
# Two checks of the numbers: frets stand where twelve to the octave puts them, and their heights are a smooth relief.

# %%
scale_m = case.string.length_m
tempered_m = scale_m * (1 - 2 ** (-np.arange(1, 21) / 12))
s = frets_m / 0.591
relief_m = -1e-3 * (0.203 + 3.6 * frets_m + 0.649 * 4 * s * (1 - s))
off_mm = 1e3 * np.abs(frets_m - tempered_m).max()
rms_um = 1e6 * np.sqrt(np.mean((heights_m - relief_m) ** 2))
top = int(np.argmax(start.u[0]))
print(
    f"{len(frets_m)} frets, at most {off_mm:.1f} mm from equal temperament; heights within {rms_um:.0f} µm rms of a parabolic relief"
)

# %%
Markdown(f"""| | the paper | here |
| --- | --- | --- |
| frets | 20 | {len(frets_m)}, at most {off_mm:.1f} mm from equal temperament |
| pluck | 64 cm from the nut, 3.6 mm | largest {1e3 * start.u[0, top]:.2f} mm at {100 * start.positions[top]:.0f} cm; the corner is rounded by ±6.7 mm, as in the authors' data |
| nearest fret | – | fret 1, {1e3 * -heights_m[0]:.2f} mm below the string at rest |""")

# %%
assert len(frets_m) == 20 and off_mm < 1.2 and rms_um < 40
assert abs(start.positions[top] - 0.64) < 0.006 and 3.5e-3 < start.u[0, top] <= 3.6e-3
assert (np.diff(heights_m) <= 0).all() and heights_m.max() == -0.63e-3
