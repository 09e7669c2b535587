"""What a live session closes with."""

from __future__ import annotations

from dataclasses import dataclass

from synth.host.performance import Performance, counted
from synth.live.status import clock_text


@dataclass(kw_only=True)
class LiveReport(Performance):
    """What was played live. Loads are shares of a block's time; times in seconds.

    ended: "stopped", "duration", "song" or "device" (the device went and did not come back).
    block, block_asked: frames that the device asked for at a time, and those that were asked of it.
    xruns: blocks that the device missed.  stalls: how often it asked more than two blocks off its time.
    late_ours, late_machine: blocks that took longer than they last, because of this program's own work or because the
    machine ran something else meanwhile.
    """

    block: int
    block_asked: int
    device_latency_s: float
    played_s: float
    ended: str
    xruns: int
    stalls: int
    late_ours: int
    late_machine: int
    load_median: float
    load_worst: float
    events: int
    events_lost: int
    recording_lost: int
    files: list[str]

    def lines(self) -> list[str]:
        """The closing lines."""
        notes = counted(self.notes, "note") + (f" ({self.lost} not played)" if self.lost else "")
        xruns = counted(self.xruns, "xrun")
        if late := self.late_ours + self.late_machine:
            blocks = counted(late, "late block")
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
        lines += self.lines_of_strings()
        if self.events_lost:
            events = "event was" if self.events_lost == 1 else "events were"
            lines.append(f"  {self.events_lost} {events} lost: too many arrived at once")
        if self.recording_lost:
            lines.append(f"  the disk was too slow: the recording lacks frames or events ({self.recording_lost})")
        if self.files:
            lines.append(f"  written: {', '.join(self.files)}")
        return lines
