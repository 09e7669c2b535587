"""What a live session closes with."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from synth.live.status import clock_text


@dataclass(frozen=True)
class LiveReport:
    """What was played. Loads are shares of a block's time; times in seconds.

    ended: "stopped", "duration", "song" or "device" (the device went and did not come back).
    block, block_asked: frames that the device asked for at a time, and those that were asked of it.
    xruns: blocks that the device missed.  stalls: how often it asked more than two blocks off its time.
    late_ours, late_machine: blocks that took longer than they last, because of this program's own work or because the
    machine ran something else meanwhile.
    unplayed: dicts of part, note, count, reason.
    """

    output: str
    rate_hz: int
    block: int
    block_asked: int
    device_latency_s: float
    parts: list[str]
    seed: int
    prepare_s: float
    played_s: float
    ended: str
    notes: int
    strings: int
    xruns: int
    stalls: int
    late_ours: int
    late_machine: int
    load_median: float
    load_worst: float
    events: int
    events_lost: int
    recording_lost: int
    stolen: int
    taken_over: int
    silenced: int
    limiter_reduction_db: float
    unplayed: list[dict[str, Any]]
    files: list[str]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The closing lines."""
        lost = sum(entry["count"] for entry in self.unplayed)
        notes = f"{self.notes} note{'' if self.notes == 1 else 's'}" + (f" ({lost} not played)" if lost else "")
        xruns = f"{self.xruns} xrun{'' if self.xruns == 1 else 's'}"
        late = self.late_ours + self.late_machine
        if late:
            blocks = f"{late} late block{'' if late == 1 else 's'}"
            xruns += f" ({blocks}: {self.late_ours} by this program, {self.late_machine} by the machine)"
        lines = [
            f"played {clock_text(self.played_s)}, {notes}, {xruns}, load {100.0 * self.load_median:.0f} % in the median, "
            f"{100.0 * self.load_worst:.0f} % at worst"
        ]
        if self.block != self.block_asked:
            lines.append(f"  the server asked for blocks of {self.block} frames, not {self.block_asked}")
        if self.stalls:
            times = "once" if self.stalls == 1 else f"{self.stalls} times"
            lines.append(f"  the output asked for sound more than two blocks late {times}; the sound may have gaps there")
        lines += [f"  not played: {e['count']} × {e['note']} ({e['part']}): {e['reason']}" for e in self.unplayed[:12]]
        if self.stolen:
            cut = "string was cut short for a new note" if self.stolen == 1 else "strings were cut short for new notes"
            lines.append(f"  {self.stolen} sounding {cut} (see --polyphony)")
        if self.silenced:
            often = "once" if self.silenced == 1 else f"{self.silenced} times"
            lines.append(f"  the motion of a string blew up and was silenced {often}; use --scheme exact-hold")
        if self.events_lost:
            events = "event was" if self.events_lost == 1 else "events were"
            lines.append(f"  {self.events_lost} {events} lost: too many arrived at once")
        if self.recording_lost:
            lines.append(f"  the disk was too slow: the recording lacks frames or events ({self.recording_lost})")
        if self.files:
            lines.append(f"  written: {', '.join(self.files)}")
        return lines
