"""Small presets, a way to feed events in blocks, and looks into the engine's state, for the tests of this folder."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import Preset, parse_preset
from synth.midi.events import EVENT, make_events
from synth.solver.stringmodel import StringModel, StringState

RATE_HZ = 44100.0
QUANTUM = layout.QUANTUM


def steel(notes: str, name: str = "") -> str:
    """A [[string]] table: plain steel, 0.9 m."""
    return f"""
[[string]]
name = "{name}"
notes = "{notes}"
length_m = 0.9
diameter_mm = 0.4
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
thermoelastic_q_inverse = 2.03e-4
"""


def wound(note: str, linear_density_g_m: float) -> str:
    """A [[string]] table of a long-scale bass."""
    return f"""
[[string]]
name = "{note}"
notes = "{note}"
length_m = 0.863
diameter_mm = 1.14
linear_density_g_m = {linear_density_g_m}
core_diameter_mm = 0.43
winding_diameter_mm = 0.355
youngs_modulus_gpa = 301
viscoelastic_loss = 0.01
thermoelastic_q_inverse = 6e-6
"""


def preset(
    name: str,
    strings: str,
    *,
    obstacle: str = 'kind = "none"',
    pluck: str = "",
    damping: str = "release_s = 0.2",
    output: str = 'kind = "displacement"\nposition = 0.1\ngain_db = 50',
    polyphony: int = 24,
    more: str = "",
) -> Preset:
    """A preset out of its tables."""
    text = f"""format = 2
name = "{name}"
{strings}
[obstacle]
{obstacle}
[pluck]
displacement_mm = 2.0
position = 0.3
width_mm = 10
{pluck}
[damping]
{damping}
[output]
{output}
[mapping]
polyphony = {polyphony}
{more}
"""
    return parse_preset(text, name)


#: nothing to touch; C3…E3 and G3, notes 48…52 and 55
FREE = preset("free", steel("C3-E3") + steel("G3"))
BRIDGE_OBSTACLE = 'kind = "bridge"\ndistance_mm = 6.0\njiva_um = 3.0'
FORCE = 'kind = "force"\nposition = 0.012\ngain_db = -6'
#: a tanpura: G2, and two strings at C3; notes 43 and 48
BRIDGE = preset(
    "bridge",
    steel("G2", "Pa") + steel("C3", "Sa 1") + steel("C3", "Sa 2"),
    obstacle=BRIDGE_OBSTACLE,
    damping="ring_on = true",
    output=FORCE,
)
#: its thread so thin that the string rests on the bridge: 20 µm too low
PRESSED = preset("pressed", steel("G2"), obstacle='kind = "bridge"\ndistance_mm = 6.0\njiva_um = -20.0', output=FORCE)
#: a curved bridge without a thread, and a neck before it
CURVE_OBSTACLE = 'kind = "bridge"\ndistance_mm = 8.0\npoints = 4\nradius_mm = 8000.0\nfrets = 2'
CURVE = preset(
    "curve", steel("G2", "jor") + steel("C3", "baj"), obstacle=CURVE_OBSTACLE, damping="ring_on = true", output=FORCE
)
NECK_OBSTACLE = 'kind = "frets"\ncount = 12\naction_12th_mm = 2.3\nnut_height_mm = 0.6\nrelief_mm = 0.3'
#: E A D G with twelve frets; notes 28…55
NECK = preset(
    "neck",
    wound("E1", 32.5) + wound("A1", 20.9) + wound("D2", 13.8) + wound("G2", 6.69),
    obstacle=NECK_OBSTACLE,
    output='kind = "pickup"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12\ngain_db = -18',
    polyphony=4,
)
#: its G string alone, heard as the force on the bridge
ONE_NECK = preset("one-neck", wound("G2", 6.69), obstacle=NECK_OBSTACLE, output='kind = "force"\ngain_db = -24', polyphony=1)

#: two strings over two frets, on a bridge that moves with a body, each in two directions; notes 43…45 and 48…50
SHARED = preset(
    "shared",
    wound("G2", 6.69) + wound("C3", 3.76) + "place_mm = 12\n",
    obstacle='kind = "frets"\ncount = 2\nheights_mm = [-0.7, -0.9]',
    polyphony=2,
    output='kind = "body"\ngain_db = -40',
    more="""
[[body.mode]]
frequency_hz = 120
q = 20
mass_kg = 0.6
shape = [1.0, 0.1, 2.0]
pan = -0.5
[[body.mode]]
frequency_hz = 300
q = 30
mass_kg = 0.3
shape = [0.9, -0.2, -3.0]
[polarisation]
detuning_cents = 0.5
pluck_deg = 40
""",
)
#: a small sitar: such strings, and one over a single point, on a bridge that moves with a body
SITAR = preset(
    "small-sitar",
    steel("G2", "jor") + steel("C3", "baj") + "place_mm = 8\n" + steel("G3", "chikari") + "bridge_points = 1\n",
    obstacle=CURVE_OBSTACLE,
    damping="ring_on = true",
    output='kind = "body"\ngain_db = -40',
    more="""
[[body.mode]]
frequency_hz = 180
q = 20
mass_kg = 0.2
""",
)


def engine(*parts: Preset, quality: str = "standard", limiter: bool = False, **more) -> Engine:
    """An engine that is prepared."""
    more.setdefault("warn", lambda text: None)
    made = Engine(parts, quality=quality, limiter=limiter, **more)
    made.prepare(RATE_HZ, 4096)
    return made


def play(
    made: Engine, events: np.ndarray | Iterable[tuple], frames: int, blocks: Iterable[int] | int = 512, stems=None
) -> np.ndarray:
    """(frames, 2) output from now on; events are rows of `make_events`, frames from now on, in any order."""
    rows = events if isinstance(events, np.ndarray) else make_events(list(events))
    rows = rows[np.argsort(rows["frame"], kind="stable")]
    out = np.zeros((frames, 2))
    sizes = iter([blocks] * (frames // blocks + 1) if isinstance(blocks, int) else blocks)
    begin = 0
    while begin < frames:
        end = min(frames, begin + next(sizes))
        here = rows[(rows["frame"] >= begin) & (rows["frame"] < end)].copy()
        here["frame"] -= begin
        part = None
        if stems is not None:
            part = np.zeros((stems.shape[0], end - begin, 2))
        made.process(here, out[begin:end], part)
        if stems is not None:
            stems[:, begin:end] = part
        begin = end
    return out


def what_sounds(made: Engine) -> dict[str, np.ndarray]:
    """All that changes while an engine sounds, as it is now."""
    return {name: array.copy() for name, array in made.memory.changing.items()}


def go_on_from(made: Engine, state: dict[str, np.ndarray]) -> None:
    """Puts what was kept of an engine that was prepared in the same way into its place."""
    for name, array in made.memory.changing.items():
        array[: len(state[name])] = state[name]


def bank_of(made: Engine) -> layout.Bank:
    """The constant arrays of a prepared engine."""
    assert made._bank is not None
    return made._bank


def until_state_at(made: Engine, events, frame: int) -> np.ndarray:
    """Play from the start until the strings stand exactly at a frame (a multiple of the quantum)."""
    assert frame % QUANTUM == 0
    return play(made, events, frame + QUANTUM, QUANTUM)


def state_of(made: Engine, s: int) -> tuple[np.ndarray, np.ndarray]:
    """q, v of string s: views into the state, as many modes as its model has."""
    model, string = bank_of(made).models[made._sounding.hands["model"][s]], made._strings.states.items[s]
    return string.q[: model["n"]], string.v[: model["n"]]


def string_of(made: Engine, s: int) -> StringState:
    """What changes of string s."""
    return made._strings.states.items[s]


def model_of(made: Engine, s: int) -> StringModel:
    """The model of string s as compiled."""
    return made._strings.models[made._sounding.hands["model"][s]]


def energy(made: Engine, s: int) -> float:
    """½ μ Σ (v² + ω² q²) of string s [J]."""
    q, v = state_of(made, s)
    model = model_of(made, s)
    return 0.5 * model.mu * float(np.sum(v**2 + (model.omega[: model.modes] * q) ** 2))


def awake(made: Engine) -> list[int]:
    """Indices of the strings that are awake."""
    return [int(s) for s in np.flatnonzero(made._sounding.voices["awake"])]


def place(made: Engine, s: int) -> tuple[str, int]:
    """Name of string s and the fret it is stopped at."""
    model = made._sounding.hands["model"][s]
    position = bank_of(made).positions[bank_of(made).positions["model"] == model][0]
    return made.compiled[int(position["part"])].strings[s].name, int(position["fret"])


def random_events(rng: np.random.Generator, count: int, frames: int, channels: int, notes: tuple[int, int]) -> np.ndarray:
    """A stream of everything that a player can do, wild but in range."""
    from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM

    out = np.zeros(count, EVENT)
    out["frame"] = np.sort(rng.integers(0, frames, count))
    for row in out:
        row["channel"] = rng.integers(channels)
        kind = rng.choice([NOTE_ON, NOTE_OFF, CONTROL, BEND, PROGRAM, PARAMETER], p=[0.5, 0.2, 0.15, 0.06, 0.03, 0.06])
        row["kind"] = kind
        if kind in (NOTE_ON, NOTE_OFF):
            row["a"], row["b"] = rng.integers(notes[0], notes[1] + 1), rng.integers(0, 128)
        elif kind == CONTROL:
            controllers = [1, 6, 7, 10, 11, 38, 64, 64, 68, 68, 100, 101, 120, 121, 123]
            row["a"] = rng.choice(controllers)
            row["b"] = 0 if row["a"] in (100, 101) else rng.integers(0, 128)
            if row["a"] == 6:
                row["b"] = rng.integers(0, 13)
        elif kind == BEND:
            row["a"] = rng.integers(-8192, 8192)
        elif kind == PROGRAM:
            row["a"] = rng.integers(0, 2)
        else:
            index = int(rng.integers(0, layout.N_PARAMETERS))
            row["a"], row["value"] = index, rng.uniform(*layout.PARAMETER_RANGES[index])
    return out
