"""What a plugin says of itself is told apart, and stays the same for ever."""

from __future__ import annotations

import pytest

from synth.instrument.preset import load_preset
from synth.plugin.bankfile import uid_of
from synth.plugin.description import describe
from tests.engine.kit import BRIDGE, FREE, NECK


def titles(*named: tuple[str, str]) -> list[str]:
    return [
        each.name
        for each in describe([FREE.model_copy(update={"name": name, "title": title}) for name, title in named]).presets
    ]


def test_equal_titles_are_told_apart() -> None:
    assert titles(("a", "Tanpura"), ("mine", "Tanpura"), ("b", "")) == ["Tanpura", "Tanpura (mine)", "b"]
    assert titles(("a", "X"), ("b", "x (c)"), ("c", "x")) == ["X", "x (c)", "x (c 2)"]
    long = titles(("a", "é" * 100), ("b", "é" * 100))
    assert long[0] != long[1] and long[1].endswith(" (b)") and all(len(each.encode()) <= 95 for each in long)
    assert [each.name for each in describe([FREE, BRIDGE, NECK]).presets] == [
        each.title or each.name for each in (FREE, BRIDGE, NECK)
    ]


def test_hosts_know_a_plugin_by_the_same_number_for_ever() -> None:
    assert describe([load_preset("tanpura-light")]).id == "tanpura-light"
    assert uid_of("tanpura").hex() == "79921430b3b4ad308830d47f6e21e97a"


@pytest.mark.parametrize(
    ("name", "thread"), [("sitar", False), ("veena", False), ("tanpura-light", True), ("jawari-harp", True)]
)
def test_a_thread_is_offered_where_there_is_one(name: str, thread: bool) -> None:
    """Every bridge can be raised while it sounds. A gap has the id of a thread, of all strings or by string."""
    told = describe([load_preset(name)])
    assert [row.id for row in told.parameters if row.id.startswith("obstacle.")] == ["obstacle.height"]
    named = [row.name for row in (*told.parameters, *told.setup) if "thread" in row.name.lower() or "jiva)" in row.name]
    assert bool(named) == thread
    setup = {row.id: row.name for row in told.setup}
    if not thread:
        gap = ("obstacle.jivas", "Gaps over the bridge") if name == "sitar" else ("obstacle.jiva", "Gap over the bridge")
        assert (setup[gap[0]], setup["obstacle.distance"]) == (gap[1], "Depth of the bridge")
