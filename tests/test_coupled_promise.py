"""What the plan says of strings that share a body, on random instruments that it was not calibrated on.

tests/scenes/coupled.npz was made by tools/calibrate-coupled --references: converged displacements of the string that is
played, and how far they stand against half as many steps. Where nothing touches, the reference are the complex modes of the
same strings and body. `tools/calibrate-coupled --check` has more instruments.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from promise import together, together_limits
from promise.runs import RATE_HZ, distances

from synth.dsp.measures import relative_error
from synth.instrument.compile import describe_plan, string_kind
from synth.instrument.coupled_calibration import HELD, PITCHES_HZ
from synth.instrument.coupled_plan import choose_steps, limits_together, promise_together
from synth.instrument.plan import BRIDGE, FAR, FREE, IMPACTS, choose_factor, promise
from synth.instrument.planfile import PROMISED
from synth.instrument.preset import load_preset
from synth.instrument.qualities import QUALITIES

SCENES = Path(__file__).parent / "scenes" / "coupled.npz"


@cache
def scenes() -> list[dict]:
    found = []
    with np.load(SCENES) as data:
        for name in data.files:
            if name.endswith("-stands"):
                continue
            kind, index = name.split("-")
            step, *stands = data[f"{name}-stands"]
            preset, note = together.instrument(np.random.default_rng(together.seed(kind, int(index), True)), kind)
            place = together.find(preset, note)
            opened = together.speaking(place)
            found.append(
                {
                    "name": name,
                    "made": kind,
                    "preset": preset,
                    "note": note,
                    "kind": string_kind(preset, opened.opened, opened.below),
                    "f0_hz": together.midi_to_hz(place.opened),
                    "stands": dict(zip(together_limits.MEASURES, stands, strict=True)),
                    "u": step * data[name].astype(float),
                }
            )
    return found


def ratio(scene: dict, quality: str) -> float | None:
    """Worst of error over limit with the steps of the plan; None where the reference can judge nothing."""
    steps, _ = choose_steps(scene["f0_hz"], scene["kind"], quality, RATE_HZ)
    made, seconds = scene["made"], together.DURATION_S[scene["made"]]
    u = together.displacement(scene["preset"], scene["note"], seconds, 1, steps, together.SEEN_AT[made])
    every = together_limits.EVERY[made]
    whole = every == 1
    errors = distances(u, scene["u"]) if whole else {"e": relative_error(u[::every], scene["u"])}
    # thinned, e alone can be told
    stands = scene["stands"] if whole else {**dict.fromkeys(scene["stands"], np.inf), "e": scene["stands"]["e"]}
    found = together_limits.ratios(
        [{**scene, "stands": stands, "rows": [{"factor": steps, **errors}]}],
        quality,
        limits_together(scene["kind"], quality),
    )
    return float(found[0]) if found.size else None


def test_there_are_scenes_of_both_kinds() -> None:
    kinds = [scene["kind"] for scene in scenes()]
    assert kinds.count(BRIDGE) >= 8 and kinds.count(IMPACTS) >= 16
    for quality in PROMISED:
        judging = [together_limits.judged(limits_together(s["kind"], quality), s["stands"]) for s in scenes()]
        assert sum(bool(each) for each in judging) >= 20


@pytest.mark.parametrize("quality", PROMISED)
def test_promise(quality: str) -> None:
    """Kept in 95 % of the scenes, and by no more than a factor 2 missed in any other."""
    found = {scene["name"]: ratio(scene, quality) for scene in scenes()}
    ratios = {name: each for name, each in found.items() if each is not None}
    missed = {name: round(each, 2) for name, each in ratios.items() if each >= 1.0}
    assert len(missed) <= 0.05 * len(ratios), missed
    assert max(ratios.values()) < 2.0, missed


@pytest.mark.parametrize("index", [0, 1, 2])
def test_strings_over_nothing_are_exact_but_for_the_ramp(index: int) -> None:
    preset, note = together.instrument(np.random.default_rng(together.seed("free", index, True)), "free")
    mine, exact = together.exact_displacement(preset, note, together.DURATION_S["free"], together.SEEN_AT["free"])
    assert relative_error(mine, exact) < limits_together(FREE, "draft")["e"]


def test_steps_are_those_of_the_plan_in_powers_of_two_up_to_eight() -> None:
    for kind in (BRIDGE, FAR, IMPACTS, FREE):
        for quality in QUALITIES:
            for f0 in (65.0, 110.0, 440.0):
                steps, _ = choose_steps(f0, kind, quality, 48000.0)
                wanted = choose_factor(f0, kind, quality, 48000.0)[0]
                assert steps in (1, 2, 4, 8)
                assert steps == 8 or wanted <= steps < 2 * wanted


def test_promises_in_words() -> None:
    """Of bridges those of strings with ends at rest; of blows what eight steps keep; none of what was not measured."""
    for quality in ("draft", "standard", "fine"):
        assert promise_together(BRIDGE, quality, 110.0) == promise(BRIDGE, quality)
        assert promise_together(FREE, quality, 2000.0) == "e < 0.001 over 3 s in 95 % of random scenes"
    assert promise_together(IMPACTS, "draft", 110.0) == promise(IMPACTS, "draft")
    assert promise_together(IMPACTS, "standard", 110.0) == (
        "e < 0.6 over 0.1 s, log-spectral distance < 6 dB, where chaotic third octaves within 5 dB, in 95 % of random scenes"
    )
    # no more steps, no closer
    assert promise_together(IMPACTS, "fine", 110.0) == promise_together(IMPACTS, "standard", 110.0)
    for kind in HELD:
        assert promise_together(kind, "reference", 110.0) == promise_together(kind, "fine", 110.0)
    assert promise_together(FAR, "fine", 110.0) == "not measured where strings share a body"
    low, high = PITCHES_HZ
    assert promise_together(BRIDGE, "fine", 1.05 * high) == promise_together(BRIDGE, "fine", low / 1.05)
    for f0 in (1.07 * high, low / 1.07):
        assert promise_together(BRIDGE, "fine", f0).endswith(", measured from 82.4 to 311.1 Hz")


def test_the_plan_of_a_preset_says_it() -> None:
    guitar = load_preset("steel-guitar")
    plan = describe_plan(guitar, 40, quality="standard")
    assert [row["error"] for row in plan["strings"]] == [promise_together(IMPACTS, "standard", 82.4)]
    assert "e < 0.6 over 0.1 s" in plan["text"]
    own = describe_plan(guitar, 40, internal_rate_hz=4 * 44100.0)
    assert own["strings"][0]["error"] == "not calibrated at a rate of your own" and own["strings"][0]["factor"] == 4
