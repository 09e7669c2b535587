"""The files that a repository is expected to have: they can be read, and what they name is there."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
TEXTS = ("CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "SECURITY.md")
FORMS = sorted(path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml")


def load(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", TEXTS)
def test_what_texts_name_is_there(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (ROOT / target).exists(), target
    for tool in re.findall(r"(?:\./)?(tools/[\w-]+)", text):
        assert (ROOT / tool).is_file(), tool
    for file in re.findall(r"`((?:synth|tests)/[\w/.]+)`", text):
        assert (ROOT / file).is_file(), file
    assert max(map(len, text.splitlines())) <= 140


def test_the_citation_has_what_the_format_asks_for() -> None:
    citation = load(ROOT / "CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0" and citation["type"] == "software" and citation["license"] == "MIT"
    (paper,) = citation["references"]
    assert paper["doi"] == "10.1121/1.5039740" and paper["type"] == "article"
    assert [author["family-names"] for author in paper["authors"]][:2] == ["Issanchou", "Acary"]
    for each in (citation, paper):
        assert all({"name"} <= set(author) or {"family-names", "given-names"} <= set(author) for author in each["authors"])


def test_the_workflow_runs_what_there_is() -> None:
    workflow = load(ROOT / ".github" / "workflows" / "ci.yml")
    jobs = workflow["jobs"]
    assert set(jobs) == {"linux", "elsewhere"}
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert "./tools/test --all" in commands
    assert jobs["elsewhere"]["continue-on-error"] is True  # nobody has run it there yet
    assert "continue-on-error" not in jobs["linux"]
    from synth import cli

    for command in commands:
        words = command.split()
        if words[0] == "synth" and "--version" not in words:
            cli.command_parser().parse_args(words[1:])
    files = [word for command in commands for word in command.split() if word.startswith("presets/")]
    assert files and all((ROOT / file).is_file() for file in files)


def test_what_is_packed_is_there() -> None:
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    targets = tools["hatch"]["build"]["targets"]
    paths = [*targets["sdist"]["include"], *targets["wheel"]["packages"], *targets["wheel"]["force-include"]]
    assert [path for path in paths if not (ROOT / path.lstrip("/")).exists()] == []
    assert [pattern for pattern in tools["ruff"]["lint"]["per-file-ignores"] if not list(ROOT.glob(pattern))] == []


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.name)
def test_forms_for_issues(path: Path) -> None:
    form = load(path)
    assert form["name"] and form["description"] and form["body"]
    names = [each["id"] for each in form["body"]]
    assert len(set(names)) == len(names)
    for each in form["body"]:
        assert each["type"] in ("input", "textarea") and each["attributes"]["label"]
    assert any(each.get("validations", {}).get("required") for each in form["body"])


def test_there_are_forms() -> None:
    assert [path.stem for path in FORMS] == ["bug", "idea", "sound"]
    assert load(ROOT / ".github" / "ISSUE_TEMPLATE" / "config.yml") == {"blank_issues_enabled": True}
