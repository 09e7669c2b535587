"""The buzz map and the set-up of a wish at the server: what is computed, refused, ended; a note on one string."""

from __future__ import annotations

import multiprocessing
from typing import Any

import numpy as np
import pytest

from synth.author import buzz_maps
from synth.author.beside import Stopped, compute_beside
from synth.author.phrases import phrase
from synth.instrument.excitations import ExcitationTable
from synth.instrument.neck import single_strings
from synth.instrument.preset import Preset, PresetError, load_preset
from synth.setup.buzz_map import buzz_map
from synth.setup.report import rows, summary

from .serverkit import Server
from .test_sound import RATE_HZ, listen, offline
from .test_views_served import finished


def bass(*strings: int) -> Preset:
    """The fretted bass with some of its strings."""
    preset = load_preset("fretted-bass")
    return preset.model_copy(update={"string": tuple(preset.string[i] for i in strings)})


def test_the_map_is_that_of_synth_setup_with_keys_and_strings() -> None:
    told: list[tuple[int, int]] = []
    preset = bass(0)
    found = buzz_maps.mapped(preset, "hard", lambda done, total: told.append((done, total)))
    want = buzz_map(preset, stroke="hard")
    assert [{key: note[key] for key in row} for note, row in zip(found["notes"], rows(want), strict=True)] == rows(want)
    assert [(note["table"], note["opened"], note["key"]) for note in found["notes"]] == [(0, 28, 28 + n) for n in range(21)]
    assert [note["uncertain"] for note in found["notes"]] == [spot.uncertain for spot in want.spots]
    assert found["lines"][: len(summary(want))] == summary(want)
    assert (found["stroke"], found["velocity"]) == ("hard", 120)
    assert told[-1] == (21, 21)


def test_the_map_of_a_document_is_of_what_is_edited(server: Server) -> None:
    doc = server.open("tanpura-light")
    doc.set("obstacle.jiva_um", 9)
    found = finished(server, doc.do("buzz-map", stroke="soft")["job"])
    assert found["state"] == "done" and found["progress"] == 1.0, found
    edited = load_preset("tanpura-light").with_setting("obstacle.jiva_um", "9")
    assert found["result"] == buzz_maps.mapped(edited, "soft")
    doc.do("revert")


def test_maps_that_there_are_not(server: Server) -> None:
    doc = server.open("fretted-bass")
    assert "stroke must be soft, medium, hard" in doc.do("buzz-map", 400, stroke="wild")["error"]
    assert "stroke: must be a text" in doc.do("buzz-map", 400, stroke=3)["error"]
    doc.set("obstacle", {"kind": "none"})
    for what, fields in (("buzz-map", {"stroke": "medium"}), ("set-up", {"wish": "no buzz at medium"})):
        assert "obstacle.kind is none, so that nothing can buzz" in doc.do(what, 422, **fields)["error"]
    doc.do("revert")


def test_what_is_not_plucked_has_no_map() -> None:
    bowed = bass(0).model_copy(update={"excitation": ExcitationTable(kind="bow")})
    with pytest.raises(ValueError, match=r"must be a pluck, got bow"):
        buzz_maps.mapped(bowed, "medium")


def test_a_map_is_stopped_and_its_process_ends(server: Server) -> None:
    doc = server.open("fretted-bass")
    job = doc.do("buzz-map", stroke="medium")["job"]
    assert server.client.delete(f"/api/jobs/{job}").status_code == 200
    assert finished(server, job)["state"] == "cancelled"
    shares: list[float] = []

    def until_some(share: float) -> bool:
        shares.append(share)
        return share == 0.0

    with pytest.raises(Stopped):
        compute_beside("synth.author.buzz_maps", "mapped", (bass(0, 1), "medium"), until_some)
    assert 0.0 < shares[-1] < 1.0
    assert not [each for each in multiprocessing.active_children() if each.name == "author-long"]


def test_what_the_process_raises_is_raised() -> None:
    arguments: Any = (bass(0), "wild")
    with pytest.raises(ValueError, match="stroke must be"):
        compute_beside("synth.author.buzz_maps", "mapped", arguments, lambda _: True)


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("no rattle", "the wish: must begin with a wish such as"),
        ("no buzz at medium, except string H soft", "the wish: no string is called 'H'"),
        ("longest buzz at medium", "obstacle.kind must be bridge for a long buzz, got frets"),
    ],
)
def test_wishes_that_are_not_understood(server: Server, wish: str, words: str) -> None:
    error = server.client.post(f"{server.open('fretted-bass').path}/set-up", json={"wish": wish}).json()["error"]
    assert words in error and "--" not in error


def test_a_wish_becomes_edits_that_keep_it(server: Server) -> None:
    """One step of undo; with them the bass, its open strings here, no longer buzzes."""
    wish = "no buzz at medium, except frets 1-20 may buzz, except open strings hard"
    doc = server.open("fretted-bass")
    before = doc.state["text"]
    found = finished(server, doc.do("set-up", wish=wish)["job"])
    assert found["state"] == "done", found
    result: Any = found["result"]
    assert not [line for line in result["lines"] if "--" in line]
    assert [line for line in result["lines"] if line.startswith("  action: ")]
    doc.do("edit", changes=result["changes"])
    edited = load_preset("fretted-bass")
    for change in result["changes"]:
        edited = edited.with_setting(change["path"], str(change["value"]))
    spots = buzz_map(edited, stroke="hard", frets={0}).spots
    assert len(spots) == 4 and not [each for each in spots if each.buzzes]
    assert doc.do("undo")["text"] == before


def test_a_note_is_heard_on_the_string_that_is_named(server: Server) -> None:
    """A1 as the open A string, and on the E string at fret 5: each as the engine has it of that string alone."""
    preset = load_preset("fretted-bass")
    doc = server.open("fretted-bass")
    sounds = []
    with doc.connect() as page:
        for string, opened in ((1, 33), (0, 28)):
            single = next(each for index, note, each in single_strings(preset, {33}) if (index, note) == (string, opened))
            expected = offline(single, phrase("note", single, 33, 80, RATE_HZ).events, 30000)
            page.send("audition", phrase="note", note=33, velocity=80, which="current", string=string, opened=opened)
            sounds.append(listen(page, 30000))
            assert np.array_equal(sounds[-1], expected)
        page.send("audition", phrase="note", note=33, velocity=80, string=0, opened=33)
        assert "no key plays string 0 at A1" in page.until("error")["message"]
    assert not np.array_equal(*sounds)


def test_a_wish_of_a_preset_that_touches_nothing() -> None:
    with pytest.raises(PresetError, match="nothing can buzz"):
        buzz_maps.wish_of(load_preset("fretted-bass").with_setting("obstacle", '{kind = "none"}'), "no buzz at medium")
