"""What is wrong in a file, preset or case, in the program's words: what is wanted of a value, and the value got."""

from __future__ import annotations

import re
from typing import Any

#: by pydantic's names of errors
WORDS = {
    "extra_forbidden": "no such key; the reference in the documentation lists all tables and keys",
    "missing": "missing",
    "string_pattern_mismatch": "must be lower-case letters, digits and hyphens",
    "int_from_float": "must be a whole number",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "string_type": "must be text",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
}
#: of a value that is shown, at most so many letters
MOST_SHOWN = 60


def wanted(item: Any) -> str:
    """What an error of pydantic's asks for."""
    own = item["msg"].removeprefix("Value error, ")
    own = re.sub("valid dictionary or instance of .*", "table", own).partition(", unable to parse")[0]
    own = re.sub(r"Input should be (a valid )?", "must be ", own)
    return WORDS.get(item["type"], own)


def value_got(item: Any, message: str) -> str:
    """ ", got …" where the value is one that can be shown and the message does not say it already."""
    value = item.get("input")
    if not isinstance(value, int | float | str | list) or "got " in message or item["type"] == "missing":
        return ""
    shown = repr(value)
    return f", got {shown if len(shown) <= MOST_SHOWN else shown[: MOST_SHOWN - 3] + '…'}"
