"""The engine as WebAssembly under random calls and with damaged banks: nothing ends it, and it gives numbers."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from synth.plugin import bankfile, packed_bank
from synth.plugin.packed_models import models_of

from .clapkit import PARTS, RATES

pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")

from .wasmfuzz import Fuzz, damaged, tried
from .wasmrun import Module


@pytest.fixture(scope="module")
def banks() -> dict[str, bytes]:
    """A bank of small presets, one at the rate that is played alone, and that one packed."""
    data, laid = bankfile.laid_out(PARTS, RATES[:1], quality="draft")
    rates = bankfile.bank(PARTS, RATES, quality="draft")
    return {"rates": rates, "plain": data, "packed": packed_bank.pack(data, models_of(laid))}


@pytest.mark.parametrize("events", [5000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_random_callers_hear_numbers(web_library: Path, banks: dict[str, bytes], events: int) -> None:
    report = Fuzz(web_library.read_bytes(), banks["rates"], RATES, seed=events).run(events)
    assert report.events >= events and report.peak > 0.01
    assert set(report.done) >= {"create", "destroy", "reset", "midi", "follow"}


@pytest.mark.parametrize("kind", ["plain", "packed"])
@pytest.mark.parametrize("count", [60, pytest.param(2000, marks=pytest.mark.slow)])
def test_damaged_banks_are_refused_with_a_reason(web_library: Path, banks: dict[str, bytes], kind: str, count: int) -> None:
    """Or are played: a byte may lie where nothing is read."""
    made, pages = Module(web_library.read_bytes()), []
    for _ in range(2):
        rng, refused = random.Random(count), 0
        assert tried(made, banks[kind], RATES[0]) == ""
        for _ in range(count):
            said = tried(made, damaged(banks[kind], rng), RATES[0])
            assert said == "" or len(said.split()) > 2, said
            refused += said != ""
        assert refused > 0.8 * count
        pages.append(made.memory.size(made.store))
    assert pages[0] == pages[1], "memory that does not come back"
