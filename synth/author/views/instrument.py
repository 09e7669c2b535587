"""The instrument from the side, to scale: the string at rest, what lies under it, where it is plucked and heard.

draw(preset, note, velocity=127) -> dict. Places x [m] count from the nut of the open string, the saddle is at
`open_length_m`; heights [mm] count upwards from the line of the open string at rest, over a bridge from the line on which it
would just touch the edge: the bridge stays where it is, and its thread raises the string's end. Rounded to 1e-6 m, 1e-5 mm.

    note, note_name, string (its name), table (index of its table in the file), opened (its open note), fret (0: open)
    open_length_m   from nut to saddle
    length_m        speaking length at this note
    frequency_hz    pitch of the note
    tension_n, linear_density_kg_m, impedance_kg_s, inharmonicity, diameter_mm   of the speaking string
    tension_share   its tension over what its core bears before drawn steel breaks (2 GPa)
    kind            of the obstacle: "none", "bridge", "points", "frets", "board"
    nut, saddle     {x, height}
    rest            [[x, mm] …] the string at rest at this note, a line over what it lies on (without its stiffness)
    points          [{index, x, height, gap_mm, label, in_play, drag}] the obstacle, from the nut: gap_mm from the string at
                    rest at this note down to the point (negative: pressed); in_play: the note can touch it
    board           [[x, mm] …] along the surface of a board without frets, else []
    frets           [x …] of a neck, else []; over a bridge they only stop strings, which do not touch them as they swing
    thread          {x, height, drag} of a bridge with a thread (jiva), the saddle where the string ends; else None
    finger          {x, height, fret} of a stopped note, else None
    pluck           {x, x_hard, width_m, displacement_mm (at this velocity and note),
                    shape [[x, mm] …] the string as it is let go, drag}
    output          {kind, x, width_m (a pickup's aperture), height (mm, of a pickup's magnet, else None), drag}
    extent_mm       [lowest, highest] of all heights here
    playable, reason   False and why where this note cannot sound (a fret above the string at rest)
    places          [{string, table, opened, fret}] every other place of the same note

drag: what a drag of the thing changes, {x: D | None, height: D | None}; D is

    path, offset, factor   value = offset + factor · (x in m or height in mm), held within
    minimum, maximum       as in `parameters`, None where there are none; a pluck goes no further than the middle
    anchor                 None, or the note whose entry of an anchored number the drag sets, a new one where it has none
                           (the edit sends the whole table)
    edits                  [{path, value}] that must be sent before the first such edit, usually []
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from synth.author.views.parameters import ranges
from synth.engine.stroke import FARTHEST, drawn_by, finger_distance, finger_width, pluck_force
from synth.instrument.boards import fingerboard_of
from synth.instrument.compile import full_pluck_force, output_distance, pluck_shift, with_sawari
from synth.instrument.neck import single_strings
from synth.instrument.place import NotePlace, find, open_string, speaking
from synth.instrument.preset import BoardObstacle, BridgeObstacle, FretsObstacle, PointsObstacle, Preset, at_note
from synth.physics.fingerboard import board_height
from synth.physics.obstacle import Obstacle, fret_positions
from synth.physics.string import String
from synth.units import midi_to_note

#: where drawn steel breaks [Pa]
BREAKS_PA = 2e9
Drag = dict[str, Any]
#: intervals in which a board's surface is drawn
BOARD_PLACES = 48


def draw(preset: Preset, note: int, velocity: int = 127) -> dict[str, Any]:
    """The drawing of one note; see the module's docstring. Raises PresetError where no string plays it or none can."""
    place = find(preset, note)
    opened, obstacle = open_string(place)
    length = opened.length_m
    drags = _Drags(place, length, preset.setup is not None and preset.setup.shapes_the_neck)
    neck = isinstance(preset.obstacle, FretsObstacle)
    fret_x, fret_height = 0.0, 0.0
    if neck and 0 < place.fret <= len(obstacle):
        fret_x, fret_height = obstacle.positions_m[place.fret - 1], obstacle.heights_m[place.fret - 1]
    elif isinstance(preset.obstacle, BridgeObstacle) and place.fret:
        fret_x = float(fret_positions(length, place.fret)[-1])
    reason = ""
    try:
        string = speaking(place).string
    except ValueError as error:
        string, reason = opened.with_length(length - fret_x), str(error)
    board: list[list[float]] = []
    if isinstance(place.preset.obstacle, BoardObstacle):
        board, fret_x, fret_height = _board(place.preset.obstacle, length, string.length_m)
    rest = _rest(fret_x, fret_height, length, obstacle, place)
    points = _sawari(obstacle, place, rest, drags) + _points(obstacle, place, rest, fret_x, drags)
    pluck = _pluck(place, opened, string, velocity, fret_height, drags)
    output = _output(place, string, length, drags)
    heights = [
        0.0,
        *(height for _, height in board),
        *(point["height"] for point in points),
        *(h for _, h in pluck["shape"]),
        output["height"] or 0.0,
    ]
    core = place.table.core_diameter_mm or place.table.diameter_mm
    area = math.pi * (1e-3 * at_note(core, place.opened)) ** 2 / 4.0
    drawing = {
        "note": note,
        "note_name": midi_to_note(note),
        "string": place.label,
        "table": place.index,
        "opened": place.opened,
        "fret": place.fret,
        "open_length_m": _m(length),
        "length_m": _m(string.length_m),
        "frequency_hz": round(place.sounding_hz, 4),
        "tension_n": round(string.tension_n, 3),
        "tension_share": round(string.tension_n / (area * BREAKS_PA), 4),
        "linear_density_kg_m": float(f"{string.linear_density_kg_m:.6g}"),
        "impedance_kg_s": float(f"{string.impedance_kg_s:.6g}"),
        "inharmonicity": float(f"{string.inharmonicity:.6g}"),
        "diameter_mm": round(1e3 * string.diameter_m, 4),
        "kind": preset.obstacle.kind,
        "nut": {"x": 0.0, "height": 0.0},
        "saddle": {"x": _m(length), "height": 0.0},
        "rest": rest,
        "points": points,
        "board": board,
        "frets": [point["x"] for point in points] if neck else _stops(preset, length),
        "thread": None,
        "finger": {"x": _m(fret_x), "height": _mm(fret_height), "fret": place.fret} if place.fret else None,
        "pluck": pluck,
        "output": output,
        "extent_mm": [min(heights), max(heights)],
        "playable": not reason,
        "reason": reason,
        "places": _elsewhere(preset, place),
    }
    if isinstance(preset.obstacle, BridgeObstacle) and len(obstacle):
        _raise_thread(drawing, obstacle, drags, preset.obstacle)
    return drawing


def _stops(preset: Preset, length: float) -> list[float]:
    """The frets of a neck before a bridge, or none."""
    shape = preset.obstacle
    if not isinstance(shape, BridgeObstacle) or shape.frets == 0:
        return []
    return [_m(x) for x in fret_positions(length, shape.frets)]


def _board(shape: BoardObstacle, length: float, speaking_m: float) -> tuple[list[list[float]], float, float]:
    """(x, height) along the surface of a board under an open string, and where the finger is [m]: nowhere, if it is none."""
    try:
        board = fingerboard_of(shape, length)
    except ValueError:
        return [], 0.0, 0.0
    places = [board.end_m * k / BOARD_PLACES for k in range(BOARD_PLACES + 1)]
    surface = [[_m(x), _mm(board_height(x, *board.profile))] for x in places]
    x_f = length - speaking_m
    return surface, x_f, board.stop(x_f)


def _raise_thread(drawing: dict[str, Any], obstacle: Obstacle, drags: _Drags, bridge: BridgeObstacle) -> None:
    """Turn the string of a drawing about its nut until the bridge's edge lies at height 0."""
    length, edge = drags.length_m, obstacle.positions_m[0]
    rise = -1e3 * obstacle.heights_m[0] / edge  # [mm] a metre

    def raised(x: float, height: float) -> float:
        return round(height + rise * x, 5) + 0.0

    pluck, output = drawing["pluck"], drawing["output"]
    drawing["rest"] = [[x, raised(x, height)] for x, height in drawing["rest"]]
    pluck["shape"] = [[x, raised(x, height)] for x, height in pluck["shape"]]
    for thing in (drawing["saddle"], *drawing["points"], output):
        if thing["height"] is not None:
            thing["height"] = raised(thing["x"], thing["height"])
    for thing in (pluck, output):
        drag = thing["drag"]["height"]
        if drag is not None:
            drag["offset"] -= drag["factor"] * rise * thing["x"]
    if bridge.has_thread:
        height = drags.along("obstacle.jiva_um", 0.0, 1e3 * edge / length, bridge.jiva_um)
        drawing["thread"] = {**drawing["saddle"], "drag": {"x": None, "height": height}}
    heights = [0.0, *(h for _, h in drawing["rest"]), *(h for _, h in pluck["shape"]), output["height"] or 0.0]
    drawing["extent_mm"] = [min(heights), max(heights)]


def _m(metres: float) -> float:
    return round(metres, 6)


def _mm(metres: float) -> float:
    return round(1e3 * metres, 5)


class _Drags:
    """Makes the drags of one string: value = offset + factor · coordinate, within the control's range."""

    def __init__(self, place: NotePlace, length_m: float, by_setup: bool) -> None:
        self.place = place
        self.length_m = length_m
        #: frets lie where [setup] has them, all at once
        self.by_setup = by_setup
        self._ranges = ranges(place.preset)

    def along(self, path: str, offset: float, factor: float, value: Any, edits: list[dict[str, Any]] | None = None) -> Drag:
        """D of a setting whose present value is `value`; one entry of a list is `path`.N."""
        minimum, maximum = self._ranges.get(path, (None, None))
        if path in ("pluck.position", "pluck.position_hard"):
            maximum = FARTHEST  # beyond counts as the middle
        return {
            "path": path,
            "offset": offset,
            "factor": factor,
            "minimum": minimum,
            "maximum": maximum,
            "anchor": self.place.opened if isinstance(value, dict) else None,
            "edits": edits or [],
        }


def _rest(fret_x: float, fret_height: float, length: float, obstacle: Obstacle, place: NotePlace) -> list[list[float]]:
    """Nut, fret, saddle and the points that lift the string between them: the upper hull of all from the fret on."""
    ends = [(fret_x, fret_height), (length, 0.0)]
    beyond = [(x, h) for x, h in zip(obstacle.positions_m, obstacle.heights_m, strict=True) if fret_x < x < length]
    hull: list[tuple[float, float]] = []
    for x, h in [ends[0], *beyond, ends[1]]:
        while len(hull) > 1 and _turns_up(hull[-2], hull[-1], (x, h)):
            hull.pop()
        hull.append((x, h))
    if place.fret:
        hull.insert(0, (0.0, 0.0))
    return [[_m(x), _mm(h)] for x, h in hull]


def _turns_up(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """b lies on or below the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) <= (c[1] - a[1]) * (b[0] - a[0])


def _height_at(line: list[list[float]], x: float) -> float:
    """Of a line of [x, mm] at x [mm]."""
    for (x0, h0), (x1, h1) in pairwise(line):
        if x <= x1:
            return h0 + (h1 - h0) * (x - x0) / (x1 - x0) if x1 > x0 else h1
    return line[-1][1]


def _points(
    obstacle: Obstacle, place: NotePlace, rest: list[list[float]], fret_x: float, drags: _Drags
) -> list[dict[str, Any]]:
    shape = place.preset.obstacle
    taut = rest if not place.fret else rest[1:]
    straight = [taut[0], taut[-1]]
    out = []
    for index, (x, height) in enumerate(zip(obstacle.positions_m, obstacle.heights_m, strict=True)):
        line = straight if x > fret_x else rest
        out.append(
            {
                "index": index,
                "x": _m(x),
                "height": _mm(height),
                "gap_mm": round(_height_at(line, x) - 1e3 * height, 5),
                "label": _label(place, index),
                "in_play": not isinstance(shape, FretsObstacle) or index >= place.fret,
                "drag": _drag_of_point(place, obstacle, index, drags),
            }
        )
    return out


def _sawari(frets: Obstacle, place: NotePlace, rest: list[list[float]], drags: _Drags) -> list[dict[str, Any]]:
    """The hill by the nut that an open string has; it is counted behind the frets."""
    whole = frets if place.fret else with_sawari(place.preset, place.opened, frets)
    shape = place.preset.obstacle
    if len(whole) == len(frets) or not isinstance(shape, FretsObstacle):
        return []
    x, height = whole.positions_m[0], whole.heights_m[0]
    drag = {
        "x": drags.along("obstacle.sawari_distance_mm", 0.0, 1e3, shape.sawari_distance_mm),
        "height": drags.along("obstacle.sawari_um", 0.0, -1e3, shape.sawari_um),
    }
    gap = round(_height_at(rest, x) - 1e3 * height, 5)
    return [
        {
            "index": len(frets),
            "x": _m(x),
            "height": _mm(height),
            "gap_mm": gap,
            "label": "sawari",
            "in_play": True,
            "drag": drag,
        }
    ]


def _label(place: NotePlace, index: int) -> str:
    match place.preset.obstacle:
        case FretsObstacle():
            return f"fret {index + 1}"
        case BridgeObstacle():
            return "bridge"
        case _:
            return f"point {index + 1}"


def _drag_of_point(place: NotePlace, obstacle: Obstacle, index: int, drags: _Drags) -> dict[str, Drag | None]:
    shape, length = place.preset.obstacle, drags.length_m
    if isinstance(shape, BridgeObstacle):
        part = shape.points / (len(obstacle) - index)  # how many times as far from the saddle the last point is
        if shape.distance_mm is not None:
            x = drags.along("obstacle.distance_mm", 1e3 * length * part, -1e3 * part, shape.distance_mm)
        else:
            x = drags.along("obstacle.distance_ratio", part, -part / length, shape.distance_ratio)
        return {"x": x, "height": None}  # it is the thread that is raised
    if isinstance(shape, PointsObstacle):
        return {
            "x": drags.along(f"obstacle.positions_mm.{index}", 0.0, 1e3, None),
            "height": drags.along(f"obstacle.heights_mm.{index}", 0.0, 1.0, None),
        }
    assert isinstance(shape, FretsObstacle)
    if drags.by_setup:
        return {"x": None, "height": None}
    edits: list[dict[str, Any]] = []
    if not shape.heights_mm:  # a neck given by its action gets the heights that it has, one by one
        heights = [_mm(height) for height in obstacle.heights_m]
        table: dict[str, Any] = {"kind": "frets", "count": shape.count, "heights_mm": heights}
        if shape.sawari_distance_mm is not None:
            table |= {"sawari_distance_mm": shape.sawari_distance_mm, "sawari_um": shape.sawari_um}
        edits = [{"path": "obstacle", "value": table}]
    height = drags.along(f"obstacle.heights_mm.{index}", 0.0, 1.0, None, edits)
    return {"x": None, "height": height}


def _pluck(
    place: NotePlace, opened: String, string: String, velocity: int, fret_height: float, drags: _Drags
) -> dict[str, Any]:
    table, length, speaking = place.preset.pluck, opened.length_m, string.length_m
    strength = velocity / 127.0
    hard = table.hardest_position
    shift = pluck_shift(place.preset, place.table, place.opened)
    share = table.position + shift + strength * (hard - table.position)
    distance = finger_distance(share, length, speaking)
    width = finger_width(
        1e-3 * table.width_mm, table.hardest_width_mm / table.width_mm, strength, distance, table.width_course == "ratios"
    )
    full = at_note(table.displacement_mm, place.opened)
    full_force = full_pluck_force(place.preset, place.table, opened, place.opened)
    moved = drawn_by(pluck_force(full_force, strength, table.velocity_exponent), distance, speaking, string.tension_n)
    crest = fret_height * distance / speaking + moved
    start = [] if not place.fret else [[0.0, 0.0]]
    if table.position_hard is None:
        place_now = drags.along("pluck.position", 1.0 - shift, -1.0 / length, table.position)
    elif strength < 0.5:  # share = (1 − strength) position + strength position_hard
        part = 1.0 - strength
        at_saddle = (1.0 - shift - strength * hard) / part
        place_now = drags.along("pluck.position", at_saddle, -1.0 / (length * part), table.position)
    else:
        offset = (1.0 - shift - (1.0 - strength) * table.position) / strength
        place_now = drags.along("pluck.position_hard", offset, -1.0 / (length * strength), hard)
    displacement = None
    if moved > 0.0:  # the crest lies above the fret's line by what the pluck moves, which is proportional to the setting
        factor = full / (1e3 * moved)
        line = 1e3 * fret_height * distance / speaking
        displacement = drags.along("pluck.displacement_mm", -line * factor, factor, table.displacement_mm)
    return {
        "x": _m(length - distance),
        "x_hard": _m(length - hard * length),
        "width_m": _m(width),
        "displacement_mm": _mm(moved),
        "shape": [*start, [_m(length - speaking), _mm(fret_height)], [_m(length - distance), _mm(crest)], [_m(length), 0.0]],
        "drag": {"x": place_now, "height": displacement},
    }


def _output(place: NotePlace, string: String, length: float, drags: _Drags) -> dict[str, Any]:
    output = place.preset.output
    distance = output_distance(place.preset, string, length)
    pickup = output.magnetic
    return {
        "kind": output.kind,
        "x": _m(length - distance),
        "width_m": _m(1e-3 * output.aperture_mm) if pickup else 0.0,
        "height": -output.distance_mm if pickup else None,
        "drag": {
            "x": drags.along("output.position", 1.0, -1.0 / length, output.position),
            "height": drags.along("output.distance_mm", 0.0, -1.0, output.distance_mm) if pickup else None,
        },
    }


def _elsewhere(preset: Preset, place: NotePlace) -> list[dict[str, Any]]:
    out = []
    for index, opened, alone in single_strings(preset, {place.note}):
        if (index, opened) != (place.index, place.opened):
            other = NotePlace(alone, index, opened, place.note - opened)
            out.append({"string": other.label, "table": index, "opened": opened, "fret": other.fret})
    return out
