# %% [markdown]
# # Figure 8: spectrograms of the bass
#
# Issanchou et al., JASA 143(5), 2018, section IV B. The paper's figure shows spectrograms of the signals of figure 7: measured,
# Moreau–Jean, penalty. It says: a similar structure; energy transfers between 0 and 0.09 s, while the string touches the
# fretboard; and reinforced spectral zones, "e.g., around 4500 Hz", which the simulations retrieve.
#
# Here Moreau–Jean (ϱ = 1) at 4.2336 MHz, the penalty at 8.4672 MHz and exact-hold at 1.0584 MHz over 0.4 s.

# %%
import os
import tomllib

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

import synth
from synth.dsp.measures import log_spectral_distance
from synth.research.case import case_path

SHORT = os.environ.get("JAWARI_NOTEBOOK") == "short"
factor = 24 if SHORT else 96
duration_s = 0.2 if SHORT else 0.4

# %%
same = {"modes": 863, "duration_s": duration_s}
runs = {
    "Moreau–Jean, ϱ = 1": synth.simulate(
        "bass", scheme="moreau-jean", restitution=1.0, internal_rate_hz=factor * 44100, **same
    ),
    "penalty": synth.simulate(
        "bass", scheme="compliant", stiffness=1e10, internal_rate_hz=(1 if SHORT else 2) * factor * 44100, **same
    ),
    "exact-hold": synth.simulate("bass", scheme="exact-hold", internal_rate_hz=24 * 44100, **same),
}
case = tomllib.loads(case_path("bass").read_text(encoding="utf-8"))
case["obstacle"]["heights_m"] = [-1e-2] * 20
free = synth.simulate(case, scheme="exact-hold", internal_rate_hz=24 * 44100, **same)
assert not free.contact_force.any()
u = {name: run.u[:, 0] for name, run in runs.items()}

# %%
figure, axes = plt.subplots(1, 3, figsize=(9, 3.5), sharey=True, layout="constrained")
spectra = {}
for axis, (name, each) in zip(axes, u.items(), strict=True):
    power, hertz, seconds, _ = axis.specgram(each, NFFT=1024, noverlap=896, Fs=44100, cmap="magma")
    levels = 10 * np.log10(np.maximum(power, 1e-30))
    axis.images[0].set_clim(levels.max() - 70, levels.max())
    axis.axvline(runs[name].last_contact_s, color="w", lw=0.8, ls=":")
    axis.set(title=name, ylim=(0, 10000), xlabel="s")
    spectra[name] = power
axes[0].set_ylabel("Hz")
plt.show()

# %% [markdown]
# The dotted line is the last contact. What goes where: the power above 2 kHz in windows of 20 ms against that of
# the same string without frets; and where between 3 and 8 kHz the velocity's spectrum, 600 Hz wide, stands out over the first 0.1 s.


# %%
def above_2_khz(u: np.ndarray, start_s: float) -> float:
    """Power of what is above 2 kHz in 20 ms of the displacement [m²]."""
    piece = u[round(start_s * 44100) : round((start_s + 0.02) * 44100)]
    power = np.abs(np.fft.rfft(piece * np.hanning(piece.size))) ** 2
    return float(power[np.fft.rfftfreq(piece.size, 1 / 44100) > 2000].sum())


def zones_hz(name: str) -> list[float]:
    """Middles of the zones between 3 and 8 kHz that stand out most from a smooth spectrum of the velocity [Hz]."""
    mean = spectra[name][:, seconds < 0.1].mean(axis=1) * hertz**2
    width = 14  # bins of 43 Hz
    level = 10 * np.log10(np.convolve(mean, np.ones(width) / width, "same"))
    inside = (hertz > 3000) & (hertz < 8000)
    trend = np.polyval(np.polyfit(hertz[inside], level[inside], 2), hertz)
    lifted = np.where(inside, level - trend, -np.inf)
    peaks = [k for k in range(1, hertz.size - 1) if lifted[k] > max(lifted[k - 1], lifted[k + 1]) and lifted[k] > 0.5]
    return [float(hertz[k]) for k in sorted(peaks, key=lambda k: -lifted[k])]


moments = (0.02, 0.05, 0.09, 0.15)
shares = {
    name: [10 * np.log10(above_2_khz(each, s) / above_2_khz(free.u[:, 0], s)) for s in moments] for name, each in u.items()
}
zones = {name: zones_hz(name) for name in u}
distance_db = {
    name: log_spectral_distance(each, u["Moreau–Jean, ϱ = 1"], 44100, size=1024, hop=256) for name, each in u.items()
}
for name in u:
    print(f"{name:20} above 2 kHz {', '.join(f'{db:.1f}' for db in shares[name])} dB; zones {', '.join(f'{hz:.0f}' for hz in zones[name])} Hz; "
          f"last contact {1e3 * runs[name].last_contact_s:.0f} ms")  # fmt: skip

# %%
red = shares["Moreau–Jean, ϱ = 1"]
strongest = {name: each[0] for name, each in zones.items()}
Markdown(f"""| | the paper | here |
| --- | --- | --- |
| penalty against Moreau–Jean | similar structure | log-spectral distance {distance_db["penalty"]:.1f} dB over {duration_s:g} s; exact-hold {distance_db["exact-hold"]:.1f} dB |
| energy transfers | 0 to 0.09 s | last contacts at {", ".join(f"{1e3 * run.last_contact_s:.0f}" for run in runs.values())} ms; above 2 kHz, against the string without frets: {red[0]:+.0f} dB at 20 ms, {red[1]:+.0f} dB at 50 ms, {red[2]:+.0f} dB at 90 ms, {red[3]:+.0f} dB at 150 ms |
| reinforced zones | "e.g., around 4500 Hz" | the strongest: {strongest["Moreau–Jean, ϱ = 1"]:.0f} Hz, penalty {strongest["penalty"]:.0f} Hz, exact-hold {strongest["exact-hold"]:.0f} Hz |""")

# %%
assert max(distance_db.values()) < 6.0
assert all(abs(each - 4500) < 300 for each in strongest.values()), strongest
assert all(min(each) > 3 for each in shares.values()), shares  # dB more than without frets: twice the power
