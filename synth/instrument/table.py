"""What every table of a preset's file has in common, and how options write its values."""

from __future__ import annotations

import tomllib
from typing import Any

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A table of the file: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def written_value(text: str) -> Any:
    """The value that an option's text stands for: read as TOML where it is TOML, else the text itself."""
    try:
        return tomllib.loads(f"v = {text}")["v"]
    except (ValueError, RecursionError):
        return text


def kind_of(table: Any, what: str) -> str:
    """The kind that a table of the file names. Raises ValueError where it names none."""
    kind = table.get("kind")
    if not isinstance(kind, str):
        raise ValueError(f"missing; it names the kind of {what}" if kind is None else f"must be text, got {kind!r}")
    return kind
