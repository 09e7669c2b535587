"""Presets by family and tag."""

import pytest

from synth.instrument.catalogue import by_family, find, notes_of, row
from synth.instrument.preset import Preset, PresetError, load_preset


def named(name: str, family: str = "", tags: tuple[str, ...] = ()) -> Preset:
    return load_preset("tanpura-light").model_copy(update={"name": name, "family": family, "tags": tags})


THREE = [named("z", "harp", ("buzz", "steel")), named("own", tags=("steel",)), named("a", "harp", ("buzz",))]


def names(presets: list[Preset]) -> list[str]:
    return [preset.name for preset in presets]


def test_families_in_order_and_those_without_last() -> None:
    assert [(family, names(members)) for family, members in by_family(THREE)] == [("harp", ["a", "z"]), ("", ["own"])]
    assert by_family([]) == []


def test_all_tags_must_fit_and_a_family_counts_as_one() -> None:
    assert names(find(THREE)) == ["a", "z", "own"]
    assert names(find(THREE, ["steel"])) == ["z", "own"]
    assert names(find(THREE, [" Buzz", "HARP"])) == ["a", "z"]
    assert names(find(THREE, ["steel"], "harp")) == ["z"]
    assert find([]) == []


def test_what_there_is_not_is_said_with_the_nearest() -> None:
    with pytest.raises(PresetError, match=r"the tag 'stel' \(perhaps steel\?\); there are buzz, harp, steel"):
        find(THREE, ["stel"])
    with pytest.raises(PresetError, match=r"the family 'bass'; there are harp"):
        find(THREE, family="bass")
    only = [*THREE, named("b", "bass")]
    with pytest.raises(PresetError, match="no preset has family bass and tag steel together"):
        find(only, ["steel"], "bass")


def test_a_row_is_plain_data() -> None:
    told = row(THREE[0])
    assert told["articulations"] == ["normal"]
    assert told["family"] == "harp" and told["tags"] == ["buzz", "steel"] and told["range"] == ["C2", "C3"]
    assert notes_of(THREE[0]) == "C2–C3"
    one = named("one").model_copy(update={"string": (load_preset("tanpura-light").string[0],)})
    assert notes_of(one) == "G2"
