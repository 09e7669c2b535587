"""Version and date of a release stand in synth/_version.py; whatever repeats them says the same."""

import datetime
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import synth
from synth import _version, cli

ROOT = Path(__file__).resolve().parents[1]


def test_what_they_look_like() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", _version.__version__)
    assert datetime.date.fromisoformat(_version.DATE) > datetime.date(2020, 1, 1)


def test_the_package_and_the_command_say_it(capsys) -> None:
    assert synth.__version__ == _version.__version__
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"synth (jawari) {_version.__version__}\n"


def test_packages_are_built_with_it() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["dynamic"] == ["version"] and "version" not in project["project"]
    file = ROOT / project["tool"]["hatch"]["version"]["path"]
    assert file == Path(_version.__file__).resolve()
    assert re.findall(r'^__version__ = "(.*)"$', file.read_text(encoding="utf-8"), re.MULTILINE) == [_version.__version__]


def test_plugins_say_it() -> None:
    """The native library, and so each plugin, is told the version of the package when it is built."""
    from synth.plugin import library

    assert "version=synth.__version__" in Path(library.__file__).read_text(encoding="utf-8")
    for source in library.SOURCES.glob("*.[ch]"):
        assert _version.__version__ not in source.read_text(encoding="utf-8"), source.name


def test_the_citation_says_it() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], str(citation["date-released"])) == (_version.__version__, _version.DATE)


def test_the_changelog_begins_with_it() -> None:
    file = ROOT / "CHANGELOG.md"
    text = (file if file.exists() else ROOT / "README.md").read_text(encoding="utf-8")
    newest = re.search(r"^#{2,3} \[?v?(\d+\.\d+\.\d+)", text, re.MULTILINE)
    assert newest is not None and newest[1] == _version.__version__
