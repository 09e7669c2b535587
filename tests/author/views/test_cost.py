"""Cost and reference: what a plan takes and promises, and how far it is from a converged run."""

import json

import numpy as np
import pytest

from synth.author.views.cost import estimate
from synth.author.views.reference import Cancelled, compare
from synth.author.views.runs import run
from synth.instrument.compile import describe_plan
from synth.instrument.place import find
from synth.instrument.preset import load_preset

from .kit import preset, tanpura


@pytest.mark.parametrize(
    ("name", "note", "scene"),
    [("tanpura-light", 48, "bridge"), ("fretted-bass", 45, "impacts"), ("free", 48, "nothing to touch")],
)
def test_the_cost_is_that_of_the_plan(name: str, note: int, scene: str) -> None:
    cost = estimate(preset(name), note)
    json.dumps(cost, allow_nan=False)
    (plan,) = [row for row in describe_plan(find(preset(name), note).preset, note)["strings"]]
    for mine, theirs in (
        ("rate_hz", "internal_rate_hz"),
        ("factor", "factor"),
        ("modes", "modes"),
        ("contacts", "contacts"),
    ):
        assert cost[mine] == plan[theirs], mine
    assert (cost["promise"], cost["reason"], cost["scene"]) == (plan["error"], plan["reason"], scene)
    assert cost["real_time_factor"] > 0.0 and cost["load"] == pytest.approx(
        cost["polyphony"] / cost["real_time_factor"], rel=0.01
    )
    assert cost["worst_block"] > 1.0 / cost["real_time_factor"] / 2.0
    row = next(row for row in cost["qualities"] if row["quality"] == "standard")
    assert (row["factor"], row["promise"]) == (plan["factor"], plan["error"])
    assert [row["factor"] for row in cost["qualities"]] == sorted(row["factor"] for row in cost["qualities"])


def test_a_better_quality_is_nearer_to_the_reference() -> None:
    errors = [estimate(load_preset("jawari-harp"), 72, quality=q)["error"]["e"] for q in ("standard", "fine", "reference")]
    assert errors[0] > errors[1] > errors[2] == 0.0
    with pytest.raises(ValueError, match="quality must be one of"):
        estimate(tanpura(), 48, quality="best")


def test_a_note_beside_its_reference() -> None:
    shares: list[float] = []

    def progress(share: float) -> bool:
        shares.append(share)
        return True

    shown = compare(tanpura(), 48, 64, 1.0, progress)
    assert len(json.dumps(shown, allow_nan=False)) < 500_000
    assert 0.0 < shown["e"] < 0.1 and shown["e_100ms"] < shown["e"]  # what standard promises of a bridge
    assert shown["doubt"]["e"] < shown["e"] / 3.0
    assert shown["reference"]["rate_hz"] > 4 * shown["standard"]["rate_hz"]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0 and len(shares) > 50
    assert shown["waveforms"]["bin_s"] * 400 == pytest.approx(1.0, rel=1e-4)
    for key in ("standard", "reference", "difference"):
        assert len(shown["waveforms"][key]["low"]) == len(shown["waveforms"][key]["high"]) == 400
    detail = {key: np.array(shown["detail"][key]) for key in ("standard", "reference", "difference")}
    np.testing.assert_allclose(detail["standard"] - detail["reference"], detail["difference"], atol=2e-6)
    rows = np.array(shown["spectrogram_difference"]["rows"])
    assert rows.shape[0] == len(shown["spectrogram_difference"]["hz"]) and rows.min() < 128 < rows.max()


def test_a_comparison_can_be_cancelled() -> None:
    for after in (0, 5, 60):
        calls = 0

        def progress(share: float, after: int = after) -> bool:
            nonlocal calls
            calls += 1
            return calls <= after

        with pytest.raises(Cancelled):
            compare(tanpura(), 48, 64, 1.0, progress)
        assert calls == after + 1


def test_a_run_is_what_the_engine_plays() -> None:
    from synth.engine.engine import Engine
    from synth.host.string_tape import RATE_HZ
    from synth.midi.events import NOTE_ON, make_events

    engine = Engine([load_preset("tanpura-light")], limiter=False)
    engine.prepare(RATE_HZ)
    out = np.zeros((22050 + engine.latency_samples, 2))
    engine.process(make_events([(0, NOTE_ON, 0, 48, 90)]), out)
    mine = run(load_preset("tanpura-light"), find(load_preset("tanpura-light"), 48), 90, 0.5, "standard")
    np.testing.assert_array_equal(mine.sound, out[engine.latency_samples :, 0])
    assert mine.displacement.any()


@pytest.mark.parametrize("seconds", [0.1, 31.0])
def test_impossible_lengths_are_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match=r"seconds must lie between 0\.2 and 30"):
        compare(tanpura(), 48, 100, seconds)


def test_a_string_that_is_not_plucked_has_no_error() -> None:
    still = preset("free").with_setting("pluck.displacement_mm", "0.0")
    shown = compare(still, 48, 100, 0.3)
    assert shown["e"] is None and shown["doubt"]["e"] is None
    assert estimate(still, 48)["error"]["e"] is None
