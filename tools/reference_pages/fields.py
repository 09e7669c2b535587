"""What a field of a validated table takes: its kind, range and default, out of the schema."""

from __future__ import annotations

import types
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined


@dataclass
class Range:
    """Ends of a range, None where there is none; open: the end itself is refused."""

    low: float | None = None
    high: float | None = None
    low_open: bool = False
    high_open: bool = False

    def at_least(self, low: float, is_open: bool = False) -> None:
        if self.low is None or low > self.low or (low == self.low and is_open):
            self.low, self.low_open = low, is_open

    def at_most(self, high: float, is_open: bool = False) -> None:
        if self.high is None or high < self.high or (high == self.high and is_open):
            self.high, self.high_open = high, is_open

    def __str__(self) -> str:
        low = "" if self.low is None else f"{'above ' if self.low_open else ''}{number(self.low)}"
        high = "" if self.high is None else f"{'below ' if self.high_open else ''}{number(self.high)}"
        if low and high:
            return f"{low}, {high}" if self.high_open else f"{low} to {high}"
        if low:
            return low if self.low_open else f"{low} or more"
        return (high if self.high_open else f"{high} or less") if high else ""


def number(value: float) -> str:
    """A number as people write it."""
    if abs(value) < 1e12 and value == int(value) and int(value) % 1000:
        return f"{int(value)}".replace("-", "−")
    text = f"{value:.12g}".replace("-", "−") if abs(value) < 1e6 and (value == 0.0 or abs(value) >= 1e-4) else f"{value:g}"
    return text.replace("e+0", "e").replace("e+", "e").replace("e-0", "e−").replace("e-", "e−")


def inner_table(annotation: Any) -> list[type[BaseModel]]:
    """The tables that a field holds: one, or of several kinds; none."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    found: list[type[BaseModel]] = []
    for inner in get_args(annotation):
        found += [each for each in inner_table(inner) if each not in found]
    return found


def is_list(annotation: Any) -> bool:
    """Whether a field holds a list, whatever of."""
    origin = get_origin(annotation)
    if origin in (Annotated, Union, types.UnionType):
        return any(is_list(inner) for inner in get_args(annotation)[: 1 if origin is Annotated else None])
    return origin in (list, tuple)


def takes_of(field: FieldInfo) -> str:
    """What a field takes, in words: its kind and its range."""
    words = list(dict.fromkeys(_kinds(field.annotation, field.metadata)))
    limits = range_of(field)
    out = []
    for word in sorted(words, key=lambda each: each != "number"):
        if word == "number":
            out.append(limits or word)
        elif word == "numbers at notes" and "number" in words:
            out.append("at notes")
        elif word == "list of numbers" and "number" in words:
            out.append("a list of such")
        elif limits and (word in ("whole number", "note", "numbers at notes") or word.startswith("list of")):
            out.append(f"{word}, {limits}")
        else:
            out.append(word)
    return " or ".join(out).replace(" or at notes", ", or at notes")


def _kinds(annotation: Any, metadata: Iterable[Any] = ()) -> Iterable[str]:
    functions = {getattr(getattr(each, "func", None), "__name__", "") for each in metadata}
    origin, inside = get_origin(annotation), get_args(annotation)
    if "_note_range" in functions:
        yield "note or range of notes"
    elif "_note" in functions:
        yield "note"
    elif "_controller" in functions:
        yield from ("number of a controller", "table")
    elif "anchors" in functions:
        yield from ("numbers at notes",) if origin is dict else ("number", "numbers at notes")
    elif origin is Annotated:
        yield from _kinds(inside[0], inside[1:])
    elif origin in (Union, types.UnionType):
        for each in inside:
            if each is not types.NoneType:
                yield from _kinds(each, metadata)
    elif origin is Literal:
        yield " or ".join(f"`{'true' if each is True else each!r}`".replace("'", '"') for each in inside)
    elif origin in (list, tuple):
        if len(inside) == 2 and inside[1] is not Ellipsis:
            yield "list of two numbers"
            return
        of = " or ".join(dict.fromkeys(_kinds(inside[0])))
        yield f"list of {of}s" if of in ("number", "table", "whole number") else f"list of {of}"
    elif origin is dict or (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        yield "table"
    else:
        yield {bool: "true or false", int: "whole number", float: "number", str: "text"}[annotation]


def range_of(field: FieldInfo) -> str:
    """The range of a field's numbers, or of how many items a list has; "" where there is none."""
    numbers, items = Range(), Range()
    _gather(field.annotation, field.metadata, numbers, items)
    if str(numbers):
        return str(numbers)
    if items.low is None or items.high is None:
        return f"at most {items.high} items" if items.high is not None else f"at least {items.low}" if items.low else ""
    return f"{items} items"


def _gather(annotation: Any, metadata: Iterable[Any], numbers: Range, items: Range) -> None:
    for each in _flat(metadata):
        if {"low", "high"} <= set(getattr(each, "__dataclass_fields__", ())):  # Between, EachBetween, Within
            numbers.at_least(each.low)
            numbers.at_most(each.high)
        match each:
            case Ge(ge=low):
                numbers.at_least(low)
            case Gt(gt=low):
                numbers.at_least(low, True)
            case Le(le=high):
                numbers.at_most(high)
            case Lt(lt=high):
                numbers.at_most(high, True)
            case MinLen(min_length=low):
                items.at_least(low)
            case MaxLen(max_length=high):
                items.at_most(high)
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        _gather(inside[0], inside[1:], numbers, items)
    elif origin in (Union, types.UnionType, list, tuple):
        for each in inside:
            _gather(each, (), numbers, items)


def _flat(metadata: Iterable[Any]) -> Iterable[Any]:
    for each in metadata:
        if isinstance(each, FieldInfo):
            yield from _flat(each.metadata)
        else:
            function = getattr(each, "func", None)
            yield function if hasattr(function, "low") else each


def default_of(field: FieldInfo) -> str:
    """The default of a field; "required" where the file must have it, "" where the default is its absence."""
    if field.is_required():
        return "**required**"
    value = None if field.default is PydanticUndefined else field.default
    if value is None or value == () or value == "" or isinstance(value, BaseModel):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, tuple):
        return f"`[{', '.join(number(each) for each in value)}]`"
    return number(value)


def aliases(field: FieldInfo, name: str) -> list[str]:
    """Other names that a field may have in the file."""
    choices = getattr(field.validation_alias, "choices", [])
    return [each for each in choices if each != name]
