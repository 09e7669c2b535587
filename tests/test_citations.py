"""BibTeX of what a run rests on."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import synth
from synth.research.citations import ARTICLES, bibtex, sources_of
from synth.solver.schemes import ON_A_BODY, SCHEMES

ENTRY = re.compile(r"@(\w+)\{(\w+),\n((?:  \w+ *= \{.*\},\n)+)\}")


def entries(text: str) -> dict[str, dict[str, str]]:
    """Fields by key of every entry; the text holds nothing else, and its braces match."""
    found = ENTRY.findall(text)
    assert ENTRY.sub("", text).strip() == "" and len({key for _, key, _ in found}) == len(found)
    fields = {key: dict(re.findall(r"  (\w+) *= \{(.*)\},\n", body)) for _, key, body in found}
    assert all(value.count("{") == value.count("}") for each in fields.values() for value in each.values())
    return fields


@pytest.mark.parametrize("scheme", [*SCHEMES, *ON_A_BODY])
def test_every_scheme_names_the_program_and_the_paper(scheme: str) -> None:
    told = entries(bibtex(scheme, sources_of(scheme, on_a_body=scheme in ON_A_BODY)))
    assert told["jawari"]["version"] == synth.__version__ and scheme in told["jawari"]["title"]
    assert told["issanchou2018"]["doi"] == "10.1121/1.5039740"
    assert ("weinreich1977" in told) == (scheme in ON_A_BODY)


def test_a_method_of_others_names_them() -> None:
    assert "bilbao2023" in sources_of("scalar-auxiliary-variable")
    assert "ducceschi2021" in sources_of("energy-quadratisation")
    assert "issanchou2017" in sources_of("compliant") and "issanchou2017" not in sources_of("exact-hold")


def test_every_article_can_be_found() -> None:
    for fields in ARTICLES.values():
        assert {"author", "title", "journal", "volume", "pages", "year"} <= fields.keys()
        assert re.fullmatch(r"10\.\d{4}/\S+", fields["doi"])


def test_a_run_and_a_result_that_was_read_say_the_same(tmp_path: Path) -> None:
    ran = synth.simulate("tanpura", scheme="moreau-jean", duration=0.001, rate=24 * 44100, modes=20)
    ran.save(tmp_path / "run.npz")
    told = ran.citation()
    assert entries(told).keys() == {"jawari", "issanchou2018"}
    assert synth.load_result(tmp_path / "run.npz").citation() == told


def test_strings_on_a_body_name_their_source() -> None:
    assert "weinreich1977" in entries(synth.simulate("guitar-pair", duration=0.001).citation())


def test_a_finger_that_lets_the_string_slide_names_its_source() -> None:
    finger = {"position_m": 0.2, "displacement_m": 1e-3, "draw_s": 1e-3}
    tables = synth.load_case("tanpura", internal_rate_hz=88_200, modes=50, duration_s=0.002).model_dump(exclude_unset=True)
    runs = [synth.simulate(tables | {"finger": [finger | {"slip_s": slip_s}]}) for slip_s in (0.0, 5e-4)]
    assert ["chadefaux2013" in entries(run.citation()) for run in runs] == [False, True]


def test_cite_names_the_program_and_what_was_used() -> None:
    assert entries(synth.cite()).keys() == {"jawari", "issanchou2018"}
    run = synth.simulate("tanpura", quality="draft", duration=0.001)
    assert synth.cite(run) == run.citation()
    assert "weinreich1977" in entries(synth.cite(synth.load_preset("steel-guitar")))
    assert "weinreich1977" not in entries(synth.cite(synth.load_preset("fretted-bass")))
    with pytest.raises(TypeError, match="cite takes a Result"):
        synth.cite("tanpura")  # type: ignore[arg-type]


def test_a_sound_names_the_methods_of_its_strings() -> None:
    alone, shared = (
        synth.render([(52, 90, 0.02)], name, quality="draft", tail=0.0) for name in ("fretted-bass", "steel-guitar")
    )
    assert ["weinreich1977" in entries(sound.citation()) for sound in (alone, shared)] == [False, True]
    assert synth.cite(shared) == shared.citation() and "exact-hold" in entries(shared.citation())["jawari"]["title"]
