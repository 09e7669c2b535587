"""Names of columns that a study's rows have of their own."""

from __future__ import annotations

#: before a column's name in a part: what is not the same again
TIME = "time."
_OWN = {"key", "code", "failure", "failed_at", "reference", "not_measured"}


def is_own(name: str) -> bool:
    """Whether no parameter, measure or result may be called so."""
    return name in _OWN or name.startswith(TIME)
