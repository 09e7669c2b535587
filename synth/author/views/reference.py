"""A note beside a converged run of it.

compare(preset, note, velocity=100, seconds=3.0, progress=…, *, quality="standard", rate_hz=44100.0) -> dict.

The note is held and played at the quality asked for, at `reference`, and at half the rate of `reference`, which tells how
far that one itself can be trusted.

    e, e_100ms        relative error of the displacement against the reference, over all and over the first 0.1 s
    log_spectral_db, third_octave_db   of the sounds; all four as `synth.dsp.measures`, null for a note that does not sound
    doubt             {the same four} of the run at half the reference's rate: below a third of them the reference can judge
    promise           of the plan, in words
    standard, reference   {rate_hz, modes, seconds (that it took)} of the plan and of the reference; so below
    waveforms         {bin_s, standard: {low, high}, reference: {low, high}, difference: {low, high}} by bins, of the sounds
    detail            {start_s, step_s, standard: [...], reference: [...], difference: [...]} samples of the first `DETAIL_S`
                      after the release
    spectrogram_difference   {start_s, step_s, hz: [... of the rows], span_db, rows: [[0 … 255 per column] per row]}:
                      standard less reference, 128 no difference, 0 and 255 −span_db and span_db, what lies more than
                      −`FLOOR_DB` below the loudest left out

progress(share) is called with 0 … 1 some hundred times; where it returns False, Cancelled is raised. Raises PresetError
where no string plays the note, ValueError for a length out of range.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.author.views.pictures import rows_of_power, waveform
from synth.author.views.runs import NoteRun, differences, run
from synth.dsp.measures import stft_power
from synth.host.string_tape import QUALITY, RATE_HZ
from synth.instrument.place import find
from synth.instrument.preset import Preset

SHORTEST_S, LONGEST_S = 0.2, 30.0
DETAIL_S = 0.05
WAVE_BINS = 400
FRAME = 2048
COLUMNS = 300
#: below this level both sounds count as equally silent, and what black and white stand for
FLOOR_DB, SPAN_DB = -70.0, 12.0


class Cancelled(Exception):
    """The comparison was stopped by its caller."""


def _always(share: float) -> bool:
    return True


@threadpool_limits.wrap(limits=1, user_api="blas")
def compare(
    preset: Preset,
    note: int,
    velocity: int = 100,
    seconds: float = 3.0,
    progress: Callable[[float], bool] = _always,
    *,
    quality: str = QUALITY,
    rate_hz: float = RATE_HZ,
) -> dict[str, Any]:
    """The comparison of one note; see the module's docstring."""
    if not SHORTEST_S <= seconds <= LONGEST_S:
        raise ValueError(f"seconds must lie between {SHORTEST_S:g} and {LONGEST_S:g}, got {seconds:g}")
    place = find(preset, note)

    def part(begin: float, end: float) -> Callable[[float], None]:
        def go_on(share: float) -> None:
            if not progress(begin + share * (end - begin)):
                raise Cancelled

        return go_on

    def timed(at: str, begin: float, end: float, internal_hz: float | None = None) -> tuple[NoteRun, dict[str, Any]]:
        begun = time.perf_counter()
        go_on = part(begin, end)
        done = run(preset, place, velocity, seconds, at, rate_hz=rate_hz, internal_rate_hz=internal_hz, go_on=go_on)
        plan = done.position.plan
        return done, {"rate_hz": plan.rate_hz, "modes": plan.modes, "seconds": round(time.perf_counter() - begun, 3)}

    mine, of_mine = timed(quality, 0.0, 0.05)
    reference, of_reference = timed("reference", 0.05, 0.7)
    half_hz = rate_hz * max(1, reference.position.plan.factor // 2)
    half, _ = timed("reference", 0.7, 1.0, half_hz)
    difference = mine.sound - reference.sound
    begin = round(mine.release_s * rate_hz)
    detail = slice(begin, begin + round(DETAIL_S * rate_hz))
    result = {
        **differences(mine, reference, rate_hz),
        "doubt": differences(half, reference, rate_hz),
        "promise": mine.position.plan.error,
        "standard": of_mine,
        "reference": of_reference,
        "waveforms": _outlines({"standard": mine.sound, "reference": reference.sound, "difference": difference}, rate_hz),
        "detail": {
            "start_s": begin / rate_hz,
            "step_s": 1.0 / rate_hz,
            "standard": np.round(mine.sound[detail], 6).tolist(),
            "reference": np.round(reference.sound[detail], 6).tolist(),
            "difference": np.round(difference[detail], 8).tolist(),
        },
        "spectrogram_difference": _spectrogram_difference(mine.sound, reference.sound, rate_hz),
    }
    progress(1.0)
    return result


def _outlines(sounds: dict[str, np.ndarray], rate_hz: float) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, x in sounds.items():
        out[name] = waveform(x, rate_hz, WAVE_BINS)
        out["bin_s"] = out[name].pop("bin_s")
    return out


def _spectrogram_difference(x: np.ndarray, reference: np.ndarray, rate_hz: float) -> dict[str, Any]:
    hop = max(256, -(-x.size // COLUMNS))
    middle = np.zeros(FRAME // 2)  # columns stand at the middles of their frames
    powers = [stft_power(np.concatenate([middle, y]), FRAME, hop) for y in (x, reference)]
    floor = max(float(powers[1].max()) * 10.0 ** (FLOOR_DB / 10.0), 1e-300)
    (hz, mine), (_, theirs) = (rows_of_power(np.maximum(power, floor), rate_hz / FRAME) for power in powers)
    shade = np.clip(np.round(128.0 + 127.0 * (mine - theirs) / SPAN_DB), 0, 255).astype(int)
    return {"start_s": 0.0, "step_s": hop / rate_hz, "hz": hz, "span_db": SPAN_DB, "rows": shade.tolist()}
