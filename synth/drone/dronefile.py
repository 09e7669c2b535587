"""A drone written to a file: the same events as live, block by block, however long."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import asdict, dataclass
from typing import Any

from synth.drone.cycle import Cycle, Drone
from synth.drone.pegs import TunedStrings
from synth.engine.engine import Engine
from synth.host import offline
from synth.host.audiofile import AudioWriter, container_of
from synth.units import gain_to_db

BLOCK = 4096


@dataclass(frozen=True)
class FileSettings:
    """Where to, how long, how. `path`: '-' for standard output. Times in seconds; seed: of the 16-bit dither."""

    path: str
    duration_s: float
    fade_s: float
    rate_hz: int = 44100
    quality: str = "standard"
    gain_db: float = 0.0
    threads: int | str = "auto"
    container: str | None = None
    bit_depth: str = "24"
    seed: int = 0


@dataclass(frozen=True)
class DroneReport:
    """What was written. peak_dbfs None: silence."""

    output: str
    rate_hz: int
    quality: str
    length_s: float
    strokes: int
    peak_dbfs: float | None
    limiter_reduction_db: float
    clipped_samples: int
    prepare_s: float
    render_s: float
    realtime_factor: float
    strings: list[dict[str, Any]]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)

    def line(self) -> str:
        """The closing line."""
        peak = "silent" if self.peak_dbfs is None else f"peak {self.peak_dbfs:.1f} dBFS"
        where = "standard output" if self.output == "-" else self.output
        reduced = self.limiter_reduction_db
        limiter = f", limiter reduced peaks by up to {reduced:.1f} dB" if reduced >= 0.05 else ""
        return (
            f"{where}: {self.length_s:.1f} s, {self.strokes} strokes, {peak}, {self.realtime_factor:.1f}× real time{limiter}"
        )


def write(
    strings: TunedStrings, cycle: Cycle, settings: FileSettings, *, progress: offline.Progress | None = None
) -> DroneReport:
    """Renders a drone to a file, which appears whole or not at all. progress: see offline.render.

    Raises ValueError, OSError for a file that cannot be written.
    """
    began = time.perf_counter()
    frames = round(settings.duration_s * settings.rate_hz)
    drone = Drone(strings, cycle, settings.rate_hz, duration_s=settings.duration_s, fade_s=settings.fade_s)
    writer = AudioWriter(
        settings.path,
        settings.rate_hz,
        container=container_of(settings.path, settings.container),
        bit_depth=settings.bit_depth,
        most_frames=frames,
        seed=settings.seed,
    )
    engine = Engine([strings.preset], quality=settings.quality, gain_db=settings.gain_db, threads=settings.threads)
    with closing(engine):
        engine.prepare(settings.rate_hz, BLOCK)
        prepared_s = time.perf_counter() - began
        with writer:
            rendering = offline.render(
                engine,
                drone.events,
                offline.Span(0, frames, 0, automatic=False),
                settings.rate_hz,
                writer,
                block=BLOCK,
                progress=progress,
            )
        told = engine.report()
    pitches = zip(strings.pegs.names, strings.pegs.pitches_hz, strict=True)
    return DroneReport(
        output=settings.path,
        rate_hz=settings.rate_hz,
        quality=settings.quality,
        length_s=rendering.frames / settings.rate_hz,
        strokes=int(told.notes),
        peak_dbfs=gain_to_db(rendering.peak) if rendering.peak > 0.0 else None,
        limiter_reduction_db=float(told.limiter_reduction_db),
        clipped_samples=writer.clipped,
        prepare_s=prepared_s,
        render_s=rendering.wall_s,
        realtime_factor=settings.duration_s / rendering.wall_s,
        strings=[{"name": name, "frequency_hz": hz} for name, hz in pitches],
    )
