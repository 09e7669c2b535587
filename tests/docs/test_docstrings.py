"""The docstrings of the public names: each has all sections, and its examples do what they show."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

import synth

DESCRIBED = [name for name in synth.__all__ if inspect.isclass(getattr(synth, name)) or callable(getattr(synth, name))]
#: numbers, texts and dtypes have no docstring of their own: comments say what they are
CONSTANTS = {"EVENT", "NOTE_OFF", "NOTE_ON", "__version__"}


def sections(text: str) -> dict[str, str]:
    """Title → text of the sections of a numpydoc docstring; "" → what stands before them."""
    pieces = re.split(r"^(\w[\w ]*)\n-{3,}$\n", inspect.cleandoc(text), flags=re.MULTILINE)
    return {"": pieces[0], **dict(zip(pieces[1::2], pieces[2::2], strict=True))}


def entries(text: str) -> dict[str, str]:
    """Name → what is said of it, of a section of parameters; several names on a line have it in common."""
    found = {}
    for heads, words in re.findall(r"^(\S[^\n]*)\n((?:(?: +[^\n]*)?\n)*(?: +[^\n]*)?)", text + "\n", re.MULTILINE):
        for name in heads.partition(" :")[0].split(","):
            found[name.strip().lstrip("*")] = words.strip()
    return found


def parameters_of(thing: Any) -> set[str]:
    """Names that a call of it takes; of an exception that takes what every exception does: none."""
    if inspect.isclass(thing) and issubclass(thing, BaseException) and "__init__" not in vars(thing):
        return set()
    return set(inspect.signature(thing).parameters)


def returns_something(thing: Any) -> bool:
    return not inspect.isclass(thing) and inspect.signature(thing).return_annotation not in (None, "None")


def faults(thing: Any) -> list[str]:
    """What is missing in the docstring of a class or a function, or is there and is not so."""
    text = inspect.getdoc(thing) or ""
    found = sections(text)
    summary = found[""].strip().partition("\n\n")[0]
    wrong = [] if summary and re.search(r"[.;:]$", summary) else ["no summary"]
    said = {name: words for title in ("Parameters", "Attributes") for name, words in entries(found.get(title, "")).items()}
    taken = parameters_of(thing)
    wrong += [f"parameter {name} is missing" for name in sorted(taken - said.keys())]
    wrong += [f"there is no parameter {name}" for name in sorted(said.keys() - taken)]
    wrong += [f"{name} has no meaning" for name, words in said.items() if len(words) < 2]
    if returns_something(thing) and not found.get("Returns", "").strip():
        wrong.append("no Returns")
    prose = "".join(words for title, words in found.items() if title != "Examples")
    if re.search(r"\b[Rr]aises [A-Z]\w*Error", prose) and "Raises" not in found:
        wrong.append("it says what it raises outside of Raises")
    if any(
        not re.match(r"[\w.]+(, [\w.]+)*$", head) for head in re.findall(r"^\S.*$", found.get("Raises", ""), re.MULTILINE)
    ):
        wrong.append("Raises must name exceptions")
    if ">>> " not in found.get("Examples", ""):
        wrong.append("no example")
    return wrong


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_docstring_says_all_there_is(name: str) -> None:
    assert faults(getattr(synth, name)) == []


def test_every_public_name_is_looked_at() -> None:
    assert set(synth.__all__) - set(DESCRIBED) == CONSTANTS


@pytest.mark.parametrize("name", DESCRIBED)
def test_the_examples_do_what_they_show(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(synth, name)) or ""
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert test.examples[-1].source and any(each.want for each in test.examples)
    report: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE).run(test, out=report.append)
    assert not report, "".join(report)


def doubled(value: float, times: int = 1) -> float:
    """Doubles a number some times.

    Parameters
    ----------
    value : float
        What is doubled.
    times : int
        How often.

    Returns
    -------
    float
        value · 2^times.

    Raises
    ------
    OverflowError
        For what is too large.

    Examples
    --------
    >>> 2.0 * 3.0
    6.0
    """
    return value * 2.0**times


#: what is taken out of a docstring that is whole → what is said of the rest
LEFT_OUT = MappingProxyType(
    {
        "times : int\n    How often.\n": "parameter times is missing",
        "Doubles a number some times.\n": "no summary",
        "    What is doubled.\n": "value has no meaning",
        "Returns\n-------\nfloat\n    value · 2^times.\n": "no Returns",
        ">>> 2.0 * 3.0\n": "no example",
    }
)


@pytest.mark.parametrize("piece", LEFT_OUT)
def test_what_is_missing_is_noticed(piece: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = inspect.getdoc(doubled) or ""
    assert faults(doubled) == [] and whole.count(piece) == 1
    monkeypatch.setattr(doubled, "__doc__", whole.replace(piece, ""))
    assert LEFT_OUT[piece] in faults(doubled)


def test_a_parameter_that_is_not_taken_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doubled, "__doc__", (doubled.__doc__ or "").replace("times : int", "often : int"))
    assert faults(doubled) == ["parameter times is missing", "there is no parameter often"]
