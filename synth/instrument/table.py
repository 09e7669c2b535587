"""What every table of a preset's file has in common."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A table of the file: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def kind_of(table: Any, what: str) -> str:
    """The kind that a table of the file names. Raises ValueError where it names none."""
    kind = table.get("kind")
    if not isinstance(kind, str):
        raise ValueError(f"missing; it says which {what} it is" if kind is None else f"must be text, got {kind!r}")
    return kind
