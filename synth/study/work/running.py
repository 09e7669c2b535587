"""A batch of rows on a worker: each measured, or with the reason why not. Nothing that a row does ends its batch."""

from __future__ import annotations

import os
import platform
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from synth.files.code_version import code_version
from synth.study.work import bases, modules
from synth.study.work.measuring import MEASURES
from synth.study.work.names import is_own
from synth.study.work.taken import Taken

#: rooms whose sources decide on a row's numbers
ROOMS = (
    "native", "jit", "midi", "physics", "solver", "dsp", "instrument", "engine", "research", "host", "fit", "study/work",
)  # fmt: skip
#: libraries whose versions do
LIBRARIES = ("numpy", "numba", "llvmlite", "scipy")
#: last words of a failure, at most so many letters
_MOST_WORDS = 500


@cache
def versions(rooms: tuple[str, ...] = ROOMS) -> dict[str, str]:
    """Of all that a row's numbers depend on beside its inputs: sources in these rooms, Python, libraries.

    Raises ValueError for a room that is not there.
    """
    from importlib.metadata import PackageNotFoundError, version

    found = {"code": code_version(rooms), "python": ".".join(platform.python_version_tuple()[:2])}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    return found


class Stale(str):
    """Why a worker cannot compute a study's rows: its files are not those that the study was begun with."""


def prepare(head: Mapping[str, Any]) -> str | None:
    """Makes this process ready for a study's rows; None, or why it cannot compute them as others do."""
    modules.put_first(head["path"])
    here = versions(*head.get("rooms", ()))
    other = {name: (here.get(name), wanted) for name, wanted in head["versions"].items() if here.get(name) != wanted}
    if other:
        told = ", ".join(f"{name} {mine!s:.12} instead of {wanted!s:.12}" for name, (mine, wanted) in other.items())
        return f"{platform.node()} has {told}"
    told_of = modules.unlike(head["own"], head["modules"])
    return None if told_of is None else Stale(f"{platform.node()} {told_of}")


def run_batch(head: Mapping[str, Any], reference: Any, jobs: Sequence[tuple[str, dict[str, Any], dict[str, Any]]]) -> Any:
    """Rows one after the other.

    head       of the study: measures, arrays, path, versions, its own modules and the hashes of its own files
    reference  what `run_reference` gave, or None
    jobs       (address, settings, source) each
    Returns a list of (address, values, arrays, spent) in order; values with "failure" where it failed; or text, where this
    worker has other sources than whoever asks.
    """
    unlike = prepare(head)
    if unlike:
        return unlike
    return [(key, *run_row(head, reference, settings, source)) for key, settings, source in jobs]


def run_row(
    head: Mapping[str, Any], reference: Any, settings: dict[str, Any], source: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray], dict[str, Any]]:
    """(values, arrays, spent) of a row; spent: times, which are not the same again."""
    began, wall, cpu = time.time(), time.perf_counter(), time.process_time()
    values: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    timed: dict[str, Any] = {}
    try:
        if source["kind"] == "call":
            values, arrays = _called(head, reference, settings, source)
            _check_names([*values, *arrays], {name: each for name, each in settings.items() if values.get(name) != each})
            timed = {name: values.pop(name) for name in head["times"] if name in values}
        else:
            values, arrays, timed = _measured(head, reference, settings, source)
    except (Exception, SystemExit) as error:
        values, arrays, timed = {"failure": _reason(error), "failed_at": _place(error)}, {}, {}
    spent = {
        **timed,
        "row_wall_s": time.perf_counter() - wall,
        "row_cpu_s": time.process_time() - cpu,
        "began": began,
        "worker": f"{platform.node()}:{os.getpid()}",
    }
    return values, arrays, spent


def run_reference(head: Mapping[str, Any], settings: dict[str, Any], source: Mapping[str, Any]) -> Any:
    """What rows are compared with: {"values", "arrays", "settings", "rate_hz"}, or {"failure": …}, or text as `run_batch`.

    With head["check"] a second run, with these settings more, says how far the reference stands from it.
    """
    unlike = prepare(head)
    if unlike:
        return unlike
    try:
        if source["kind"] == "call":
            values, arrays = _called(head, None, settings, source)
            return {"values": values, "arrays": arrays, "settings": settings, "rate_hz": 0.0, "expected_hz": None}
        taken = _plain(bases.run(source, settings, False))
        values = {}
        if head["check"]:
            other = bases.run(source, settings | head["check"], False)
            from synth.study.work.measuring import MEASURES as known

            judged = Taken(other.settings, other.signals, other.rate_hz, None, 0.0, 0.0, other.result, taken)
            values = {name: known[name].compute(judged) for name in ("e", "lsd_db")}
        return {
            "values": values, "arrays": {"signals": taken.signals}, "settings": settings, "rate_hz": taken.rate_hz,
            "is_case": source["kind"] == "case",
        }  # fmt: skip
    except (Exception, SystemExit) as error:
        return {"failure": _reason(error), "failed_at": _place(error), "settings": settings}


def _plain(taken: Taken) -> Taken:
    if not np.all(np.isfinite(taken.signals)):
        raise ValueError("the reference is not finite; raise its internal rate")
    return taken


def taken_of(reference: Mapping[str, Any]) -> Taken:
    """A reference as measures see it."""
    signals = np.asarray(reference["arrays"]["signals"])
    result = True if reference.get("is_case") else None  # a case's signal is its first output, a note's the mean
    return Taken(dict(reference["settings"]), signals, float(reference["rate_hz"]), result=result)


def _measured(
    head: Mapping[str, Any], reference: Any, settings: dict[str, Any], source: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray], dict[str, Any]]:
    named = head["measures"]
    ledger = any(each["name"] in MEASURES and MEASURES[each["name"]].ledger for each in named)
    taken = bases.run(source, settings, ledger)
    if reference is not None:
        if "failure" in reference:
            raise RuntimeError(f"its reference failed: {reference['failure']}")
        reference = taken_of(reference)
        taken = Taken(
            taken.settings,
            taken.signals,
            taken.rate_hz,
            taken.expected_hz,
            taken.cpu_s,
            taken.wall_s,
            taken.result,
            reference,
        )
    values: dict[str, Any] = {}
    timed: dict[str, Any] = {}
    silent = []
    for each in named:
        name, column = each["name"], each["as"]
        into = timed if column in head["times"] else values
        try:
            with np.errstate(all="ignore"):
                found = (MEASURES[name].compute if name in MEASURES else bases.function_of(name))(taken, **each["options"])
        except ValueError as error:
            silent.append(f"{column}: {_reason(error)}")
            into[column] = None
            continue
        if isinstance(found, Mapping):
            for part, value in found.items():
                (timed if part in head["times"] else values)[_text(str(part))] = plain(value)
        else:
            into[column] = plain(found)
    _check_names([*values, *timed], settings)
    if silent:
        values["not_measured"] = "; ".join(silent)
    return values, {name: _array(taken, name) for name in head["arrays"]}, timed


def _array(taken: Taken, name: str) -> np.ndarray:
    """One of a result's arrays by its name; of a note `signals` alone. Raises ValueError."""
    found = taken.signals if name in ("signals", "u") else getattr(taken.result, name, None)
    if found is None:
        raise ValueError(f"arrays: a run of this kind has no {name!r}")
    return np.asarray(found)


def _called(
    head: Mapping[str, Any], reference: Any, settings: dict[str, Any], source: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    function = bases.function_of(source["call"])
    if reference is not None:
        if "failure" in reference:
            raise RuntimeError(f"its reference failed: {reference['failure']}")
        found = function(dict(settings), reference)
    else:
        found = function(dict(settings))
    if not isinstance(found, Mapping):
        raise TypeError(f"{source['call']} must return a dict of values by name, got {type(found).__name__}")
    arrays = {str(name): value for name, value in found.items() if isinstance(value, np.ndarray) and value.ndim > 0}
    return {_text(str(name)): plain(value) for name, value in found.items() if name not in arrays}, arrays


def _check_names(names: Sequence[str], settings: Mapping[str, Any]) -> None:
    """Raises ValueError for a result that is called as what a row has already."""
    for name in names:
        if is_own(name) or name in settings:
            what = "a parameter" if name in settings else "a column of every row"
            raise ValueError(f"a result is called {name!r}, which is {what}; give it another name")


def plain(value: Any) -> Any:
    """A value as JSON and Parquet have it: NumPy's numbers as Python's, tuples as lists, half a surrogate pair as U+FFFD;
    infinity and NaN stay. Raises ValueError for whole numbers of more than a float's range."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {_text(str(key)): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > sys.float_info.max:
        raise ValueError("a whole number of more than 308 digits; return it as text")
    if value is None or isinstance(value, bool | int | float):
        return value
    raise TypeError(f"a value must be a number, text, or lists and dicts of them, got {type(value).__name__}")


def _text(value: str) -> str:
    """Text that UTF-8 can say."""
    return str(value).encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _reason(error: BaseException) -> str:
    text = _text(" ".join(str(error).split()))
    if isinstance(error, ValueError) and text:
        return text[:_MOST_WORDS]
    return f"{type(error).__name__}: {text}"[:_MOST_WORDS] if text else type(error).__name__


def _place(error: BaseException) -> str:
    """The last line of the traceback: file (without its folder), line, function."""
    frames = traceback.extract_tb(error.__traceback__)
    if not frames:
        return ""
    last = frames[-1]
    return f"{Path(last.filename).name}:{last.lineno}, in {last.name}"
