"""Rows that will fail, as far as their strings, obstacles and notes say it before anything is computed."""

from __future__ import annotations

from typing import Any

from synth.study.addressing import Addresses
from synth.study.design import Design
from synth.study.work import bases

#: faults that are told
_MOST = 20


def row_faults(addresses: Addresses, design: Design, numbers: list[int]) -> list[str]:
    """A line for each of these rows, and for each of their references, that cannot be run."""
    found: list[str] = []
    for number in numbers:
        settings = design.row(number)
        reason = _reason(addresses, settings)
        if reason is not None:
            found.append(f"row {number}: {reason}")
        asked = design.reference(settings)
        other = None if asked is None else _reason(addresses, asked)
        if other is not None and other != reason:
            found.append(f"reference of row {number}: {other}")
        if len(found) >= _MOST:
            break
    return found


def _reason(addresses: Addresses, settings: dict[str, Any]) -> str | None:
    try:
        bases.check_run(addresses.source(settings), settings)
    except (ValueError, OSError, ArithmeticError, MemoryError) as error:
        return " ".join(str(error).split()) or type(error).__name__
    return None
