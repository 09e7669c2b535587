"""The articulations of a preset as the core has them."""

from __future__ import annotations

import math

from synth.engine import layout
from synth.instrument.articulations import NORMAL, Articulation, Hand, Knock, Touch, articulation_names
from synth.instrument.preset import Pluck, Preset
from synth.native.arrays import record

#: a velocity that no note has, and a time that is the string's own
_NEVER, _OF_THE_STRING = 128, -1.0
_DB = math.log(10.0) / 20.0


def articulation_rows(preset: Preset, first_touch: int) -> tuple[list[tuple], list[tuple], int]:
    """(ARTICULATION of each of a preset, the TOUCH records that these and the end of a note need, number of the latter's).

    first_touch: number of the first of these touches; −1 stands for none.
    """
    touches: list[tuple] = []

    def number_of(touch: Touch | None) -> int:
        if touch is None:
            return -1
        touches.append(_touch(touch))
        return first_touch + len(touches) - 1

    rows = []
    for name in articulation_names(preset.articulations):
        table = preset.articulations.get(name, Articulation())
        rows.append(_articulation(preset.pluck, table, number_of(table.touch), name == NORMAL))
    return rows, touches, number_of(preset.hand.release)


def hand_fields(hand: Hand) -> dict[str, float]:
    """Fields of PART."""
    return {
        "place_spread": 1e-3 * hand.place_mm,
        "level_spread": _DB * hand.level_db,
        "width_spread": 1e-2 * hand.width_percent,
        "time_spread": 1e-2 * hand.time_percent,
        "vibrato_hz": hand.vibrato_hz,
        "vibrato": 1e-2 * hand.vibrato_cents,
        "vibrato_up": int(hand.vibrato == "up"),
        "meend": hand.meend_semitones,
        "meend_s": 1e-3 * hand.meend_ms,
        **_knock(hand.knock),
    }


def _knock(knock: Knock | None) -> dict[str, float]:
    """Fields of PART; a push of 0 N is none."""
    given = Knock(force_n=1.0) if knock is None else knock
    return {
        "knock": 0.0 if knock is None else given.force_n,
        "knock_s": 1e-3 * given.time_ms,
        "knock_delay_s": 1e-3 * given.delay_ms,
        "knock_noise": 1e-2 * given.noise_percent,
        "knock_grain_s": 1e-3 * given.grain_ms,
        "knock_release": given.release_ratio,
    }


def _touch(touch: Touch) -> tuple:
    return record(
        layout.TOUCH,
        place=touch.place,
        width=1e-3 * touch.width_mm,
        resistance=touch.resistance,
        stiffness=1e3 * touch.stiffness_n_mm,
        lift_s=0.0 if touch.lift_ms is None else 1e-3 * touch.lift_ms,
        speed=touch.speed_m_s,
        roughness=1e-6 * touch.roughness_um,
        settle_s=1e-3 * touch.settle_ms,
        grain_s=1e-3 * touch.grain_ms,
    )


def pluck_of(pluck: Pluck, table: Articulation) -> Pluck:
    """The pluck with what an articulation has of a stroke of its own."""
    own = pluck.model_copy(update={name: getattr(table, name) for name in _STROKE if getattr(table, name) is not None})
    if "position" in table.model_fields_set and table.position_hard is None:
        own = own.model_copy(update={"position_hard": None})
    if "width_mm" in table.model_fields_set and table.width_hard_mm is None:
        own = own.model_copy(update={"width_hard_mm": None})
    return own


def _articulation(pluck: Pluck, table: Articulation, touch: int, normal: bool) -> tuple:
    own = pluck_of(pluck, table)
    soft, hard = table.velocity or ((1, 127) if normal else (_NEVER, _NEVER))
    soft_slip, hard_slip = table.slip_ms, table.slip_ms if table.slip_hard_ms is None else table.slip_hard_ms
    stiffness = pluck.finger_stiffness_n_mm if table.stiffness_n_mm is None else table.stiffness_n_mm
    return record(
        layout.ARTICULATION,
        key=-1 if table.key is None else table.key,
        controller=-1 if table.controller is None else table.controller.number,
        low=0 if table.controller is None else table.controller.low,
        high=0 if table.controller is None else table.controller.high,
        soft=soft,
        hard=hard,
        stroke=layout.THROWN if table.stroke == "throw" else layout.PLUCKED,
        place_ratio=own.position / pluck.position,
        place_shift=own.hardest_position - own.position,
        width_ratio=own.width_mm / pluck.width_mm,
        hard_width_ratio=own.hardest_width_mm / own.width_mm,
        amount=table.displacement_ratio,
        draw_s=0.0 if table.draw_ms is None else 1e-3 * table.draw_ms,
        slip_s=_OF_THE_STRING if soft_slip is None else 1e-3 * soft_slip,
        hard_slip_s=_OF_THE_STRING if hard_slip is None else 1e-3 * hard_slip,
        roughness=1e-6 * own.roughness_um,
        rub=1e-2 * own.rub_percent,
        grains=own.edge_mm / own.grain_mm,
        arrival=own.arrival,
        by_ratios=int(own.width_course == "ratios"),
        knock=table.knock_ratio,
        mass=1e-3 * table.mass_g,
        speed=table.speed_m_s,
        stiffness=1e3 * stiffness,
        touch=touch,
        harmonic=int(table.harmonic),
        strum_s=1e-3 * table.strum_ms,
        slide_s=1e-3 * table.slide_ms,
    )


#: fields of a stroke that an articulation may have of its own
_STROKE = (
    "position", "position_hard", "width_mm", "width_hard_mm", "roughness_um",
    "rub_percent", "edge_mm", "grain_mm", "arrival",
)  # fmt: skip
