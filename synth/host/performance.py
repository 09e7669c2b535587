"""What is told of music that was played, whether into a file or live."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


def counted(count: int, what: str) -> str:
    """'1 note', '2 notes'."""
    return f"{count} {what}{'' if count == 1 else 's'}"


@dataclass(kw_only=True)
class Performance:
    """What a render and a live session both tell; each field as `host.render.RenderReport` says."""

    output: str | None
    parts: list[str]
    rate_hz: int
    seed: int
    prepare_s: float
    notes: int
    strings: int
    stolen: int
    taken_over: int
    silenced: int
    limiter_reduction_db: float | None
    unplayed: list[dict[str, Any]]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; what is not finite (the peak of silence in dB) is None."""
        return asdict(self)

    @property
    def lost(self) -> int:
        """Notes that no string played."""
        return sum(row["count"] for row in self.unplayed)

    def lines_of_strings(self) -> list[str]:
        """Of strings that ended before their time, for people."""
        lines = []
        if self.stolen:
            cut = "string was cut short for a new note" if self.stolen == 1 else "strings were cut short for new notes"
            lines.append(f"  {self.stolen} sounding {cut} (see --polyphony)")
        if self.taken_over:
            notes = counted(self.taken_over, "note")
            lines.append(f"  {notes} took over a string still held by another note, cutting it off")
        if self.silenced:
            often = "once" if self.silenced == 1 else f"{self.silenced} times"
            remedy = "use --scheme exact-hold or a higher --internal-rate"
            lines.append(f"  the motion of a string blew up and was silenced {often}; {remedy}")
        return lines


def of_strings(told: Any) -> dict[str, int]:
    """What an engine's report says of its strings, by the names of a Performance."""
    return {
        "strings": int(told.most_strings),
        "stolen": int(told.stolen),
        "taken_over": int(told.taken_over),
        "silenced": int(told.silenced),
    }
