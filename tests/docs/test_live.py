"""Instruments on pages of the documentation: listed with or without an engine, and a button where a page asks for one."""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
sys.path.insert(0, str(Path(__file__).parents[2] / "tools" / "documentation"))

import live
from listening import instruments

from synth.instrument.preset import list_presets
from synth.plugin import library, packed_bank, shelf

NAMES = ["tanpura", "tanpura-drone"]


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "one.md").write_text("<!-- instrument: tanpura-drone -->\n\n<!-- instrument: tanpura -->\n")
    return tmp_path / "docs"


def listed(folder: Path) -> list[dict]:
    return json.loads((folder / "live.json").read_text(encoding="utf-8"))


def test_every_instrument_that_a_page_asks_for_is_made_once(docs: Path, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "wasm").write_bytes(b"\0asm")
    monkeypatch.setattr(shelf, "web_library", lambda *_: tmp_path / "wasm")
    monkeypatch.setattr(instruments, "_bank", lambda name: name.encode())
    made: list[str] = []
    folder = tmp_path / "live"
    folder.mkdir()
    (folder / "old.jawari").write_bytes(b"")
    for _ in range(2):
        instruments.write_all(NAMES, folder, True, made.append)
    assert made == ["tanpura", "tanpura-drone"]
    found = listed(folder)
    assert [gzip.decompress((folder / each["file"]).read_bytes()) for each in found] == [b"tanpura", b"tanpura-drone"]
    assert {path.name for path in folder.iterdir()} == {
        *("jawari.js", "jawari-worklet.js", "jawari.css", "jawari.wasm", "jawari-relaxed.wasm", "live.json"),
        *(each["file"] for each in found),
    }
    page = live.fill((docs / "one.md").read_text(), "deep/one.md", folder)
    assert page.count("<button") == 2 and 'data-live="../live/"' in page and f'data-bank="{found[0]["file"]}"' in page


def test_without_an_engine_the_page_says_so(docs: Path, tmp_path: Path, monkeypatch) -> None:
    def none(*_):
        raise library.BuildError("there is none")

    monkeypatch.setattr(shelf, "web_library", none)
    said: list[str] = []
    instruments.write_all(NAMES, tmp_path / "live", True, said.append)
    assert "there is none" in said[0]
    page = live.fill((docs / "one.md").read_text(), "one.md", tmp_path / "live")
    assert "<button" not in page and page.count("live-missing") == 2


def test_the_build_is_warned_of_an_instrument_that_is_not_made(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert live.fill("<!-- instrument: tanpura -->", "one.md", tmp_path).strip() == ""
    assert "no instrument 'tanpura'" in caplog.text


def test_without_making_what_is_there_is_listed(docs: Path, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "wasm").write_bytes(b"\0asm")
    monkeypatch.setattr(shelf, "web_library", lambda *_: tmp_path / "wasm")
    monkeypatch.setattr(instruments, "_bank", lambda name: name.encode())
    folder = tmp_path / "live"
    instruments.write_all(NAMES[:1], folder, True, lambda _: None)
    monkeypatch.delattr(shelf, "web_library")
    monkeypatch.delattr(instruments, "_bank")
    instruments.write_all(NAMES, folder, False, lambda _: None)
    assert [each["file"] is None for each in listed(folder)] == [False, True]
    page = live.fill((docs / "one.md").read_text(), "one.md", folder)
    assert page.count("<button") == 1 and page.count("live-missing") == 1


def test_every_preset_is_an_instrument_and_tanpuras_with_a_drone_too() -> None:
    names = instruments.every_name()
    assert set(names) > {preset.name for preset in list_presets()}
    assert {name for name in names if name.endswith("-drone")} == {
        f"{preset.name}-drone" for preset in list_presets() if preset.family == "tanpura"
    }


def test_a_bank_for_pages_is_packed() -> None:
    assert packed_bank.unpack(instruments._bank("koto-hirajoshi")).startswith(b"JAWARIBK")
