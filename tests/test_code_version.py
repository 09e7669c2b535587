"""A hash of sources: of whole rooms, the same for the same text, another for any other."""

import re
import shutil
from pathlib import Path

import pytest

from synth.files import code_version as module
from synth.files.code_version import RESEARCH, SOUNDING, code_version


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of two rooms, hashed in place of the package."""
    for room in ("midi", "research"):
        shutil.copytree(module._PACKAGE / room, tmp_path / room)
    monkeypatch.setattr(module, "_PACKAGE", tmp_path)
    return tmp_path


def versions() -> str:
    return code_version.__wrapped__(("research", "midi"))


def test_it_is_of_what_is_there() -> None:
    assert re.fullmatch("[0-9a-f]{64}", code_version())
    assert code_version(RESEARCH) != code_version(SOUNDING)


def test_it_knows_text_name_and_place(package: Path) -> None:
    found = {versions()}
    (package / "midi" / "events.py").write_text((package / "midi" / "events.py").read_text() + "\n", encoding="utf-8")
    found.add(versions())
    (package / "midi" / "events.py").rename(package / "midi" / "occurrences.py")
    found.add(versions())
    (package / "midi" / "occurrences.py").rename(package / "research" / "occurrences.py")
    found.add(versions())
    (package / "research" / "deep").mkdir(exist_ok=True)
    (package / "research" / "deep" / "new.py").write_text("", encoding="utf-8")
    found.add(versions())
    assert len(found) == 5


def test_line_ends_are_of_no_account(package: Path) -> None:
    before = versions()
    for path in package.rglob("*.py"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert versions() == before


def test_a_room_that_is_not_there() -> None:
    with pytest.raises(ValueError, match="no room 'cellar'"):
        code_version(("cellar",))
