"""Items from the recipe and their number alone; splits without leakage."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from synth.dataset.filling import layout
from synth.dataset.items import Items, key_of, share
from synth.dataset.recipecheck import checked_items
from synth.dataset.recipefile import RecipeError
from synth.dataset.splits import number_of, split_groups
from tests.dataset.kit import HEAD, NOTES, written

PHRASE = """\
[[phrases]]
name = "two"
preset = ["jawari-harp", "tanpura-light"]
transpose = [0, -2]
stretch = { from = 0.5, to = 2.0 }
stroke = [{ at_s = 0.0, note = "D2" }, { at_s = 0.5, note = "A2", velocity = 40, hold_s = 0.3 }]
"""


def test_lists_are_gone_through_the_last_fastest(tmp_path: Path) -> None:
    items = list(Items(written(tmp_path)))
    assert len(items) == 4 * 2 * 2
    told = [(item.note, item.beats[0].velocity, dict(item.settings)["pluck.width_mm"]) for item in items]
    assert told[:5] == [(48, 60, 8.0), (48, 60, 12.0), (48, 110, 8.0), (48, 110, 12.0), (52, 60, 8.0)]
    assert [item.key for item in items[:2]] == ["n0-00000000", "n0-00000001"]
    assert len({item.seed for item in items}) == len(items)
    assert len({item.live for item in items}) == len(items)
    assert all(item.seconds == pytest.approx(0.2) for item in items)


def test_repeats_differ_in_what_is_drawn_alone(tmp_path: Path) -> None:
    items = list(Items(written(tmp_path, NOTES + "repeats = 3\n")))
    assert len(items) == 48 and [items[k].repeat for k in (0, 16, 32)] == [0, 1, 2]
    for a, b in zip(items[:16], items[16:32], strict=True):
        assert (a.note, a.beats, a.settings) == (b.note, b.beats, b.settings) and a.seed != b.seed and a.live != b.live


def test_a_count_draws_everything(tmp_path: Path) -> None:
    items = list(Items(written(tmp_path, NOTES.replace('"jawari-harp"', '["jawari-harp", "tanpura-light"]').replace(
        'note = ["C3", "E3", "G3", "C4"]', 'note = "C2-C4"') + "count = 400\n")))  # fmt: skip
    assert len(items) == 400
    tanpura = [item for item in items if item.preset == "tanpura-light"]
    assert 150 < len(tanpura) < 250 and {item.note for item in tanpura} == {36, 43, 48}
    assert max(item.note for item in items) == 60


def test_an_item_depends_on_its_table_and_number_alone(tmp_path: Path) -> None:
    """Not on tables behind, on the kinds beside, on who asks, nor on other keys of its table."""
    before = Items(written(tmp_path))
    (tmp_path / "more").mkdir()
    more = Items(written(tmp_path / "more", NOTES + 'controllers.1 = { from = 0, to = 127 }\n[[notes]]\n'
                 'preset = "tanpura-light"\nnote = "C3"\n' + PHRASE))  # fmt: skip
    assert more.size == before.size + 1 + 4
    for item in reversed(list(before)):
        other = more.by_key(item.key)
        assert (item.seed, item.live, item.beats) == (other.seed, other.live, other.beats)
    other_seed = Items(written(tmp_path, NOTES, HEAD.replace("seed = 7", "seed = 8")))
    assert all(a.seed != b.seed for a, b in zip(before, other_seed, strict=True))


def test_draws_are_what_they_have_always_been() -> None:
    """Whoever regenerates an item next year gets this one."""
    assert share(7, "n0-00000012", "live.pluck.position") == pytest.approx(0.36413539021877694, abs=1e-15)
    assert number_of("x", 7) == pytest.approx(0.9353091732968826, abs=1e-15)


def test_phrases_are_transposed_and_stretched(tmp_path: Path) -> None:
    items = list(Items(written(tmp_path, PHRASE)))
    assert [(item.preset, item.transpose) for item in items] == [
        ("jawari-harp", 0), ("jawari-harp", -2), ("tanpura-light", 0), ("tanpura-light", -2)]  # fmt: skip
    item = items[1]
    assert [beat.note for beat in item.beats] == [36, 43] and item.kind == "phrase" and item.note is None
    assert item.beats[1].at_s == pytest.approx(0.5 * item.stretch) and item.beats[1].off_s == pytest.approx(
        0.3 * item.stretch
    )
    assert item.seconds == pytest.approx(0.8 * item.stretch + 0.5)


@pytest.mark.parametrize("key", ["n0-00000016", "n1-00000000", "p0-00000000", "n0-16", "x", "", "n0-", "n-1", "n0-0000000a"])
def test_there_is_no_other_key(tmp_path: Path, key: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"there is no item {key!r}; keys run from n0-00000000 to n0-00000015")):
        Items(written(tmp_path)).by_key(key)


def test_all_that_is_wrong_is_said_at_once_with_file_and_key(tmp_path: Path) -> None:
    bad = """\
[level]
gain_db = 3
normalize_dbfs = -1
[split]
train = 0.9
[sound]
rate_hz = 44.1
bits = 16
[[notes]]
preset = "jawari-harp"
note = "H3"
velocity = [0, 60]
hold_s = -1
"""
    with pytest.raises(RecipeError) as told:
        written(tmp_path, bad, "format = 1\n")
    lines = str(told.value).splitlines()
    assert all(line.startswith(f"{tmp_path / 'recipe.toml'}: ") for line in lines)
    said = [line.removeprefix(f"{tmp_path / 'recipe.toml'}: ") for line in lines]
    for place in ("level: gain_db", "split: train", "sound.rate_hz: ", "sound.bits: no such key", "notes.0.note: ",
                  "notes.0.velocity: must lie between 1 and 127, got 0", "notes.0.hold_s: must lie"):  # fmt: skip
        assert sum(line.startswith(place) for line in said) == 1, (place, said)
    assert len(said) == 7


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("jawari-harp", "jawari-harb", "notes.0: preset 'jawari-harb' is not one of"),
        ('["C3", "E3", "G3", "C4"]', '"C0"', "notes.0: note: jawari-harp plays"),
        ("pluck.width_mm", "pluck.with_mm", "notes.0.set.pluck.with_mm: "),
        ("[8.0, 12.0]", "[8.0, -12.0]", "notes.0.set.pluck.width_mm: "),
        ("pluck.position", "pluck.places", "notes.0.live.pluck.places: jawari-harp has no such live parameter"),
        ("to = 0.3", "to = 0.8", "notes.0.live.pluck.position: must lie between 0.02 and 0.5, got 0.8"),
        ("hold_s", 'articulation = "bowed"\nhold_s', "notes.0.articulation: jawari-harp does not have 'bowed'"),
        ("hold_s", "controllers.200 = 3\nhold_s", "notes.0.controllers.200: a controller is"),
        ("[shards]", '[labels]\ncontacts = true\n[shards]', "notes.0.preset: labels: steel-guitar has strings that share"),
        ("[shards]", '[[midi]]\nfiles = "*.mid"\n[shards]', "midi.0: files: there is no file '*.mid'"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_said(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = NOTES.replace(old, new)
    if "labels" in said:
        text = text.replace('"jawari-harp"', '"steel-guitar"')
    with pytest.raises(RecipeError) as told:
        checked_items(written(tmp_path, text))
    assert str(told.value).startswith(f"{tmp_path / 'recipe.toml'}: {said}"), told.value


def test_no_group_is_in_two_splits_and_shares_are_kept(tmp_path: Path) -> None:
    """Items of one note and parameters that differ in their hand alone stay together."""
    text = NOTES.replace('["C3", "E3", "G3", "C4"]', '"C2-C6"') + "repeats = 4\n"
    plan = layout(recipe := written(tmp_path, text), items := Items(recipe))
    split_of = {key: shard.split for shard in plan.shards for key in shard.keys}
    assert len(split_of) == items.size == sum(plan.splits.values())
    of_group: dict[str, set[str]] = {}
    alike: dict[tuple, set[str]] = {}
    for item in items:
        of_group.setdefault(plan.groups[item.key], set()).add(split_of[item.key])
        alike.setdefault((item.preset, item.note), set()).add(split_of[item.key])
    assert all(len(splits) == 1 for splits in of_group.values()) and all(len(splits) == 1 for splits in alike.values())
    largest = max(list(plan.groups.values()).count(group) for group in of_group)
    for name, part in zip(("train", "validation", "test"), recipe.recipe.split.shares, strict=True):
        assert abs(plan.splits[name] - part * items.size) <= largest
    assert plan.splits["train"] > plan.splits["test"] > 0


@pytest.mark.parametrize(
    ("group_by", "groups"),
    [('"preset"', 1), ('["preset", "velocity"]', 2), ('["note", "parameters"]', 16), ('"item"', 16), ('"string"', 4)],
)
def test_groups_are_as_asked(tmp_path: Path, group_by: str, groups: int) -> None:
    recipe = written(tmp_path, NOTES.replace("train = 0.5", f"group_by = {group_by}\ntrain = 0.5"))
    assert len(set(layout(recipe, Items(recipe)).groups.values())) == groups


def test_without_exact_a_group_stays_where_it_is() -> None:
    few = {f"g{k}": 3 for k in range(400)}
    more = few | {f"h{k}": 5 for k in range(300)}
    shares = (0.8, 0.1, 0.1)
    assert split_groups(few, shares, 1, False).items() <= split_groups(more, shares, 1, False).items()
    for exact, off in ((True, 3), (False, 90)):
        found = split_groups(few, shares, 1, exact)
        for place, part in enumerate(shares):
            assert abs(3 * sum(split == place for split in found.values()) - part * 1200) <= off
    assert set(split_groups(few, (0.0, 1.0, 0.0), 1, False).values()) == {1}


def test_shards_are_shuffled_but_always_alike(tmp_path: Path) -> None:
    recipe = written(tmp_path)
    a, b = layout(recipe, Items(recipe)), layout(recipe, Items(recipe))
    assert a.shards == b.shards and max(len(shard.keys) for shard in a.shards) == 5
    keys = [key for shard in a.shards if shard.split == "train" for key in shard.keys]
    assert keys != sorted(keys)
    plain = written(tmp_path, NOTES.replace("items = 5", "items = 5\nshuffled = false"))
    keys = [key for shard in layout(plain, Items(plain)).shards if shard.split == "train" for key in shard.keys]
    assert keys == sorted(keys)


def test_keys_are_what_webdataset_takes_for_a_name() -> None:
    assert key_of("n", 12, 34) == "n12-00000034" and "." not in key_of("n", 12, 34)
