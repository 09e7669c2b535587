"""The option --cc: which controllers set which live parameters.

Light: what it checks against is loaded when there is something to check.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from synth.engine.parameters import Binding
    from synth.instrument.preset import Preset


def parse_bindings(texts: Sequence[str]) -> dict[int, list[Binding]]:
    """'74=pluck.position', '1=obstacle.height:-50:20' (several may be joined by commas) → {74: [(None, 'pluck.position',
    None, None)], …}, as `Engine(bindings=…)` takes them. Raises ValueError.
    """
    from synth.engine.parameters import INDEX_OF, check_binding

    out: dict[int, list[Binding]] = {}
    for entry in (entry.strip() for text in texts for entry in text.split(",")):
        number, equals, rest = entry.partition("=")
        identity, *ends = (field.strip() for field in rest.split(":"))
        if not equals or not number.strip().isdecimal() or not identity or len(ends) not in (0, 2):
            raise ValueError(
                f"--cc {entry!r} is not CONTROLLER=PARAMETER or CONTROLLER=PARAMETER:AT_0:AT_127; write for example "
                f"--cc 74=pluck.position (there are {', '.join(INDEX_OF)})"
            )
        try:
            low, high = (float(end) for end in ends) if ends else (None, None)
        except ValueError:
            raise ValueError(f"--cc {entry!r}: {':'.join(ends)} must be two numbers, the values at 0 and at 127") from None
        try:
            check_binding(int(number), identity, low, high)
        except ValueError as error:
            raise ValueError(f"--cc {entry!r}: {error}") from None
        out.setdefault(int(number), []).append((None, identity, low, high))
    return out


def check_parts(bindings: Mapping[int, Sequence[Binding]], parts: Sequence[Preset]) -> None:
    """Raises ValueError, naming the option, where a parameter is none of any part's."""
    from synth.engine.parameters import bound_rows

    try:
        bound_rows(bindings, parts)
    except ValueError as error:
        raise ValueError(f"--cc: {error}; bind another parameter or choose another preset") from None
