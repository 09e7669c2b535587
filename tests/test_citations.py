"""BibTeX of what a run rests on."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import synth
from synth.research.citations import ARTICLES, bibtex
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
    told = entries(bibtex(scheme, on_a_body=scheme in ON_A_BODY))
    assert told["jawari"]["version"] == synth.__version__ and scheme in told["jawari"]["title"]
    assert told["issanchou2018"]["doi"] == "10.1121/1.5039740"
    assert ("weinreich1977" in told) == (scheme in ON_A_BODY)


def test_a_method_of_others_names_them() -> None:
    assert "bilbao2023" in entries(bibtex("scalar-auxiliary-variable"))
    assert "ducceschi2021" in entries(bibtex("energy-quadratisation"))
    assert "issanchou2017" in entries(bibtex("compliant")) and "issanchou2017" not in entries(bibtex("exact-hold"))


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
