"""A step at random gives an instrument that can be played, of every preset that comes with the program."""

from __future__ import annotations

import pytest

from synth.instrument.shipped import shipped_names

from .serverkit import Server

SEEDS = (1, 2, 3)


@pytest.mark.parametrize("name", shipped_names("."))
def test_every_preset_is_randomised(server: Server, name: str) -> None:
    doc = server.open(name)
    before = doc.state
    texts = set()
    for seed in SEEDS:
        state = doc.do("randomise", seed=seed)
        texts.add(state["text"])
        assert state["notes"] == before["notes"] and state["set"] == before["set"]
        for string, was in zip(state["data"]["string"], before["data"]["string"], strict=True):
            assert all(string[key] == was[key] for key in ("choir", "frets", "bridge_points", "sounds", "notes"))
        doc.do("undo")
    assert len(texts) == len(SEEDS) and before["text"] not in texts
