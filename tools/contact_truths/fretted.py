"""The set `frets` of tools/contact-table: strokes over frets of a known action, by the engine at `fine`, with noise."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from synth.fit.fret_fit import OutOfReach, fit_frets
from synth.fit.fret_model import RATE_HZ, FretHand, FretModel, action_mm
from synth.fit.recording import FitRefused
from synth.instrument.preset import load_preset

LEAD_S, SECONDS = 0.3, 2.0
#: amplitudes over that at which the string touches
MODERATE, HARD, NONE = (0.55, 0.92, 1.07, 1.25), (0.55, 0.92, 2.2, 2.7), (0.4, 0.6, 0.8)
PRESET = "fretted-bass"
#: within which an answer is right [mm]
AIM_MM = 0.05


def run(seed: int, case: str) -> dict[str, Any]:
    """One set of recordings at random, and what the fit says of it. The place of plucking is given to within 1 mm rms."""
    rng = np.random.default_rng(seed)
    preset = load_preset(PRESET)
    string = int(rng.integers(0, len(preset.string)))
    plain = FretModel(preset, string)
    action = action_mm(preset, string) * rng.uniform(0.75, 1.25)
    hand = FretHand(rng.uniform(0.15, 0.35), rng.uniform(0.8e-3, 2.5e-3), rng.uniform(6e-3, 12e-3))
    low, high = 0.3, 15.0
    while high / low > 1.003:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if plain.touches(action, middle, hand) else (middle, high)
    shares = {"hard": HARD, "no contact": NONE}.get(case, MODERATE)
    amplitudes = [low * each * rng.uniform(0.97, 1.03) for each in shares]
    losses = {"losses × 1.3": 1.3, "losses × 0.7": 0.7}.get(case, 1.0)
    recordings = []
    for each, share in zip(amplitudes, shares, strict=True):
        slip = hand.slip_s * rng.uniform(0.9, 1.1) * (1.2 - 0.4 * min(share, 1.5))
        mine = replace(hand, slip_s=slip, draw_s=hand.draw_s * rng.uniform(0.9, 1.1), losses=losses)
        x = plain.sound(action, each, mine, SECONDS, "fine")
        x = x / np.abs(x).max() * rng.uniform(0.2, 0.8)
        lead = np.zeros(round(LEAD_S * RATE_HZ) + int(rng.integers(0, 400)))
        noise = math.sqrt(float(np.mean(x**2))) * 10.0 ** (-40.0 / 20.0)
        x = np.concatenate([lead, x])
        recordings.append((x + noise * rng.standard_normal(x.size), RATE_HZ))
    given = [each * (1.1 if case == "amplitude + 10 %" else 1.0) for each in amplitudes]
    position = hand.position + 1e-3 * rng.normal() / plain.open_m
    row: dict[str, Any] = {"key": f"frets {case} {seed}", "set": "frets", "case": case, "truth_mm": action, "string": string}
    began = time.process_time()
    try:
        found = fit_frets(recordings, preset, string, given, position=position)
        row |= {"value": found.action_mm, "half": found.half_mm, "fit_half": found.fit_half_mm}
        row |= {"bracket": [found.low_mm, found.high_mm], "error": found.action_mm - action}
        row["losses"] = [each.minimum.loss for each in found.strokes if each.minimum is not None]
    except FitRefused as refused:
        row["refused"] = str(refused)
        if isinstance(refused, OutOfReach):
            row["bound"] = refused.bound_mm
    return row | {"cpu_s": time.process_time() - began}


def line(row: dict[str, Any]) -> str:
    """A row in words."""
    if "refused" in row:
        return f"{row['key']}: refused, truth {row['truth_mm']:.3f} mm: {row['refused'][:150]} ({row['cpu_s']:.0f} s)"
    return (
        f"{row['key']}: {row['value']:.3f} mm, error {row['error']:+.3f}, ± {row['half']:.3f} (fit {row['fit_half']:.3f}) "
        f"mm, losses {row['losses'][0]:.3f} {row['losses'][1]:.3f} ({row['cpu_s']:.0f} s)"
    )


def show(rows: list[dict[str, Any]]) -> None:
    """By case: refusals, errors, coverage."""
    for case in dict.fromkeys(row["case"] for row in rows):
        mine = [row for row in rows if row["case"] == case]
        said = [row for row in mine if "error" in row]
        for row in mine:
            print(f"    {line(row)}")
        print(f"  {case}: {len(mine)} sets, {len(mine) - len(said)} refused", end="")
        if said:
            errors = np.abs([row["error"] for row in said])
            covered = sum(abs(row["error"]) <= row["half"] for row in said)
            own = sum(abs(row["error"]) <= row["fit_half"] for row in said)
            print(
                f", {int((errors <= AIM_MM).sum())} within {AIM_MM} mm; error median {np.median(errors):.4f}, worst "
                f"{errors.max():.4f} mm; interval covers {covered} of {len(said)} (the fit's part alone {own})", end="",
            )  # fmt: skip
        print(f"; {np.median([row['cpu_s'] for row in mine]):.0f} s of one core (median)")
