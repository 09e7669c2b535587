"""The scenes, as data: what `render` makes sound. Add where something new can sound; BASE says if it does not know it.

kind "engine"    presets, options and arrays for Engine, rate_hz, seconds, blocks (sizes in turn), stems,
                 events: (seconds, kind, channel or part, a, b, value), see `render.KINDS`
kind "command"   words of a command line, files and messages of the song that lie in {folder}
kind "simulate"  a case by name or as tables, and the overrides of each of its runs
Values are what JSON can hold. Random music is drawn by `random.Random.random` from fixed seeds, the same in every Python.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

Row = tuple[float, str, int, Any, int, float]
Scene = dict[str, Any]

#: strings over a bridge, on ends at rest
LIGHT = "tanpura-light"
PRESETS = (LIGHT, "fretted-bass", "jawari-harp", "steel-guitar", "fretless-bass")
QUALITIES = ("draft", "standard", "fine", "reference")
LAWS = ("exact-hold", "moreau-jean", "moreau-jean-filtered")
#: keys that show a preset's strings at the costs of its low ones
KEYS = {LIGHT: (36, 43, 48, 48), "fretted-bass": (28, 38, 45, 31), "jawari-harp": (33, 40, 52, 45),
        "steel-guitar": (40, 47, 57, 43), "fretless-bass": (28, 40, 46, 52)}  # fmt: skip
#: whose strings share a body or lie over a board, which one law knows
COUPLED = ("steel-guitar", "fretless-bass")


def scenes() -> list[Scene]:
    """All of them, each with a name of its own."""
    return [*_qualities(), *_hands(), *_controls(), *_engines(), *_songs(), *_drones(), *_cases(), *_schemes()]


# --- events


def row(at: float, kind: str, channel: int = 0, a: Any = 0, b: int = 0, value: float = 0.0) -> Row:
    return at, kind, channel, a, b, value


def note(at: float, key: int, velocity: int, length: float, channel: int = 0) -> list[Row]:
    return [row(at, "on", channel, key, velocity), row(at + length, "off", channel, key, 64)]


def control(at: float, number: int, value: int, channel: int = 0) -> Row:
    return row(at, "control", channel, number, value)


def phrase(seed: int, keys: tuple[int, ...], notes: int, seconds: float, channel: int = 0) -> list[Row]:
    """Random keys, times, lengths and velocities."""
    rng, rows = random.Random(seed), []
    for _ in range(notes):
        at, key = seconds * 0.9 * rng.random(), keys[int(len(keys) * rng.random())]
        rows += note(at, key, 20 + int(107 * rng.random()), 0.02 + 0.2 * rng.random(), channel)
    return sorted(rows, key=lambda each: each[0])


def sweep(kind: str, at: float, seconds: float, values: Sequence[float], channel: int = 0, a: Any = 0) -> list[Row]:
    """Values of a control one after the other; a bend's is its `a`, a pressure's its `b`, of others the value."""
    rows = []
    for i, value in enumerate(values):
        when = at + seconds * i / len(values)
        match kind:
            case "bend":
                rows.append(row(when, kind, channel, int(value)))
            case "control" | "pressure" | "key-pressure":
                rows.append(row(when, kind, channel, a, int(value)))
            case _:
                rows.append(row(when, kind, channel, a, 1, value))
    return rows


def engine(name: str, presets: Any, seconds: float, events: list[Row], **more: Any) -> Scene:
    presets = [presets] if isinstance(presets, str | dict) else presets
    return {"name": name, "kind": "engine", "presets": presets, "seconds": seconds, "events": events, **more}


# --- Engine


def _qualities() -> list[Scene]:
    """Every preset at every quality by every law: plucked hard, and a string that sounds plucked again."""
    found = []
    for preset in PRESETS:
        first, second, third, fourth = KEYS[preset]
        events = [*note(0.0, first, 120, 0.12), *note(0.02, second, 70, 0.3), *note(0.06, third, 100, 0.03),
                  *note(0.13, first, 90, 0.1), *note(0.17, fourth, 40, 0.1)]  # fmt: skip
        for quality in QUALITIES:
            for law in LAWS if preset not in COUPLED else LAWS[:1]:
                seconds = 0.12 if quality == "reference" else 0.2
                options = {"quality": quality, "scheme": law, "only_notes": [sorted(set(KEYS[preset]))], "every_fret": False}
                found.append(engine(f"{preset}-{quality}-{law}", preset, seconds, events, options=options))
    return found


def _hands() -> list[Scene]:
    """What fingers do: dense and legato playing, strings drawn while they sound, strings that run out."""
    harp, bass, tanpura = tuple(range(40, 64)), tuple(range(28, 52)), (36, 43, 48)
    legato = [control(0.0, 68, 127), row(0.0, "on", 0, 33, 110), row(0.06, "on", 0, 36, 100), row(0.12, "on", 0, 40, 90),
              row(0.18, "off", 0, 40), row(0.2, "on", 0, 35, 80), row(0.26, "off", 0, 36), control(0.27, 68, 0),
              row(0.28, "on", 0, 38, 100), row(0.3, "off", 0, 33)]  # fmt: skip
    hammer = [row(0.0, "on", 0, 28, 100), row(0.07, "on", 0, 31, 20), row(0.1, "on", 0, 33, 127), row(0.16, "off", 0, 33),
              row(0.2, "on", 0, 30, 60), row(0.25, "off", 0, 30)]  # fmt: skip
    redraw = [each for i in range(9) for each in note(0.03 * i, 48, 30 + 12 * i, 0.02)]
    strum = [*(row(0.015 * i, "on", 0, key, 110) for i, key in enumerate((40, 47, 52, 56, 59, 64))),
             *sweep("bend", 0.1, 0.1, [0, 2000, 5000, 8000]), row(0.22, "on", 0, 59, 127),
             row(0.3, "off", 0, 40)]  # fmt: skip
    return [
        engine("strummed-guitar", "steel-guitar", 0.5, strum),
        engine("dense-guitar", "steel-guitar", 0.4, phrase(5, tuple(range(40, 76)), 24, 0.4), options={"threads": 2}),
        engine("sliding-bass", "fretless-bass", 0.5, legato),
        engine("dense-harp", "jawari-harp", 0.5, phrase(1, harp, 60, 0.5)),
        engine("dense-harp-fine", "jawari-harp", 0.25, phrase(2, harp, 16, 0.25), options={"quality": "fine"}),
        engine("dense-bass", "fretted-bass", 0.5, phrase(3, bass, 40, 0.5)),
        engine("dense-tanpura", LIGHT, 0.5, phrase(4, tanpura, 30, 0.5)),
        engine(
            "high-harp",
            "jawari-harp",
            0.25,
            phrase(5, (84, 88, 91, 96), 8, 0.25),
            options={"only_notes": [[84, 88, 91, 96]]},
        ),
        engine("legato-bass", "fretted-bass", 0.35, legato),
        engine("hammer-on-bass", "fretted-bass", 0.3, hammer),
        engine("legato-bass-moreau-jean", "fretted-bass", 0.3, legato, options={"scheme": "moreau-jean"}),
        engine("redraw-tanpura", LIGHT, 0.35, redraw),
        engine("redraw-within-a-block", LIGHT, 0.1, [*note(0.0, 36, 90, 0.001), *note(0.0005, 36, 50, 0.001)]),
        engine("few-strings", "jawari-harp", 0.4, phrase(6, harp, 30, 0.4), options={"max_polyphony": 3}),
        engine("spared-strings", "jawari-harp", 0.4, phrase(7, harp, 30, 0.4), spare=0.02),
        engine("unplayable-notes", LIGHT, 0.1, [*note(0.0, 60, 90, 0.05), *note(0.01, 36, 90, 0.05)]),
        engine(
            "loud-and-soft",
            "fretted-bass",
            0.3,
            [*note(0.0, 28, 127, 0.1), *note(0.1, 33, 1, 0.1), *note(0.15, 43, 64, 0.1)],
        ),
    ]


def _controls() -> list[Scene]:
    """Bends, pressure, MPE, tunings, pedals, programs and live parameters."""
    chord = [row(0.0, "on", 0, 40, 90), row(0.01, "on", 0, 47, 80), row(0.02, "on", 0, 52, 100)]
    slow = sweep("bend", 0.02, 0.3, [100 * i for i in range(0, 60)])
    rpn = [control(0.0, 101, 0), control(0.0, 100, 0), control(0.0, 6, 24), control(0.0, 38, 50)]
    wide = [*rpn, *sweep("bend", 0.05, 0.25, [-8192, 8191, 0, 4096, -4096, 8191, 123])]
    rising, waves = [4 * i for i in range(32)], [0, 127, 30, 90, 0, 64]
    mpe = [each for c, key in ((1, 40), (2, 44), (3, 47)) for each in (
        row(0.0, "bend", c, 700 * c), control(0.0, 74, 30 * c, c), *note(0.01 * c, key, 80 + 10 * c, 0.2, c),
        *sweep("bend", 0.05, 0.15, [270 * i * c for i in range(10)], c), *sweep("pressure", 0.1, 0.1, rising[::4], c),
    )] + [row(0.2, "bend", 0, 4000), control(0.25, 64, 127)]  # fmt: skip
    retuned = [row(0.0, "tuning", 0, 40, 0, 40.31), *chord, *sweep("tuning", 0.1, 0.1, [46.5, 47.7, 48.25, 47.0], 0, 47)]
    just = {"note_hz": [440.0 * 2.0 ** ((key - 69) / 12.0) * (1.0 + 0.002 * (7 * key % 5 - 2)) for key in range(128)]}
    pedals = [*chord, control(0.03, 64, 127), row(0.06, "off", 0, 40), row(0.07, "off", 0, 47), control(0.12, 64, 0)]
    ends = {"all-sound-off": 120, "reset-controllers": 121, "all-notes-off": 123}
    levels = [*chord, *(control(0.04 * i, number, value) for i, (number, value) in enumerate(
        [(7, 60), (11, 90), (10, 10), (10, 120), (7, 127), (11, 20)]))]  # fmt: skip
    shares = {"pluck.position": [0.1, 0.4, 0.03], "pluck.amount": [0.3, 1.9, 1.0], "pluck.width": [1.0, 30.0, 6.0],
              "damping.release": [0.2, 8.0, 1.0], "output.gain": [0.2, 3.0, 1.0]}  # fmt: skip
    strokes = [each for i in range(6) for each in note(0.05 * i, (36, 43, 48)[i % 3], 60 + 10 * i, 0.04)]
    lively = [each for id_, values in shares.items() for each in sweep("parameter", 0.0, 0.25, values, 0, id_)]
    varied = sweep("parameter", 0.0, 0.25, [0.0, 2.0, 1.0], 0, "hand.variation")
    jiva = sweep("parameter", 0.02, 0.25, [0.0, 10.0, 30.0, 50.0, -20.0, -150.0, 0.0, 5.0], 0, "obstacle.height")
    bound = {"74": "pluck.position", "1": [[None, "obstacle.height", -50, 20]], "16": [[0, "output.gain", 0.5, 2.0]]}
    turned = [*sweep("control", 0.0, 0.2, waves, 0, 74), *sweep("control", 0.0, 0.25, waves, 0, 1),
              *sweep("control", 0.05, 0.2, waves, 0, 16)]  # fmt: skip
    parts = [part for part in PRESETS]
    programs = [[[0, 1, 2, -1][program % 4] if channel != 3 else 2 for program in range(128)] for channel in range(16)]
    changing = [row(0.0, "program", 0, 2), row(0.0, "program", 1, 1), row(0.0, "program", 2, 0),
                *phrase(11, (40, 43, 45, 48), 8, 0.3), *phrase(12, (28, 31, 36), 6, 0.3, 1),
                *phrase(13, (36, 43, 48), 6, 0.3, 2), *phrase(14, (55, 60), 4, 0.3, 3),
                row(0.12, "program", 0, 1), row(0.2, "program", 0, 3), row(0.2, "program", 1, 0)]  # fmt: skip
    found = [
        engine("bend-slow", "jawari-harp", 0.35, [*chord, *slow]),
        engine("bend-wide-rpn", "jawari-harp", 0.35, [*chord, *wide]),
        engine("bend-bass", "fretted-bass", 0.3, [*note(0.0, 38, 100, 0.25), *slow]),
        engine("bend-tanpura-fine", LIGHT, 0.2, [*note(0.0, 36, 100, 0.15), *slow], options={"quality": "fine"}),
        engine(
            "bend-moreau-jean", LIGHT, 0.2, [*note(0.0, 36, 100, 0.2), *wide], options={"scheme": "moreau-jean-filtered"}
        ),
        engine("mpe", "jawari-harp", 0.35, mpe, options={"mpe": True}),
        engine("tuning-live", "jawari-harp", 0.3, retuned),
        engine("tuning-compiled", "jawari-harp", 0.2, chord, arrays=just),
        engine("pedal-sustain", "jawari-harp", 0.3, pedals),
        engine("levels", "jawari-harp", 0.3, levels),
        engine("parameters", LIGHT, 0.35, [*strokes, *lively]),
        engine("parameter-jiva", LIGHT, 0.35, [*strokes, *jiva]),
        engine("parameter-jiva-harp", "jawari-harp", 0.35, [*chord, *jiva]),
        engine("parameters-bass", "fretted-bass", 0.3, [*phrase(15, (28, 33, 38), 8, 0.3), *lively]),
        engine("parameter-variation", "fretted-bass", 0.3, [*phrase(16, (28, 33, 38), 8, 0.3), *varied]),
        engine("bound-controllers", LIGHT, 0.35, [*strokes, *turned], options={"bindings": bound}),
        engine(
            "programs", parts, 0.4, sorted(changing, key=lambda each: each[0]), arrays={"program_map": programs}, stems=True
        ),
    ]
    for preset in PRESETS:
        first, second, *_ = KEYS[preset]
        pressed = [row(0.0, "on", 0, first, 90), row(0.01, "on", 0, second, 90),
                   *sweep("pressure", 0.05, 0.1, rising), *sweep("key-pressure", 0.1, 0.15, waves, 0, second)]  # fmt: skip
        found.append(engine(f"pressure-{preset}", preset, 0.3, pressed))
    for name, number in ends.items():
        after = note(0.2, 45, 90, 0.1)
        events = [*chord, control(0.02, 64, 127), *slow[:20], control(0.15, number, 0), *after]
        found.append(engine(f"end-{name}", "jawari-harp", 0.3, events))
    return found


#: a string over points in mid-air, and a body
POINTS = """
format = 2
name = "points"
[[string]]
notes = "A2-C3"
length_m = 0.65
diameter_mm = 0.8
linear_density_g_m = 3.9
inharmonicity = 1e-4
viscoelastic_loss = 4e-3
[obstacle]
kind = "points"
positions_mm = [100.0, 200.0, 310.0]
heights_mm = [-0.8, -1.0, -1.3]
[pluck]
displacement_mm = 3.0
[output]
kind = "velocity"
position = 0.2
gain_db = -20.0
[body]
direct_db = -3.0
resonance = [{ frequency_hz = 110.0, q = 20.0, gain_db = 3.0 }, { frequency_hz = 410.0, q = 35.0, gain_db = -4.0 }]
"""


#: and one that wraps a curved bridge of eight points
CURVED = POINTS.replace("[100.0, 200.0, 310.0]", "[1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 10.0, 13.0]").replace(
    "[-0.8, -1.0, -1.3]", "[-0.0006, -0.0022, -0.005, -0.0113, -0.02, -0.0356, -0.0556, -0.0939]"
)


def _engines() -> list[Scene]:
    """One piece of music in blocks, threads and rates of all kinds, saved and gone on with, and the engine's options."""
    harp = tuple(range(36, 60, 3))
    piece = sorted([*phrase(21, harp, 14, 0.25), *sweep("bend", 0.03, 0.1, [900, 3000, -5000, 0]), control(0.05, 64, 127),
                    control(0.2, 64, 0)], key=lambda each: each[0])  # fmt: skip
    hot = phrase(22, harp, 20, 0.2)
    slapped = {"preset": "fretted-bass", "set": {"pluck.displacement_mm": "15"}}
    plucks = [*note(0.0, 45, 110, 0.1), *note(0.04, 46, 80, 0.15), *note(0.12, 45, 60, 0.1), *note(0.1, 48, 127, 0.1)]
    found = [engine(f"blocks-{size}", "jawari-harp", 0.25, piece, blocks=[size]) for size in (1, 37, 64, 256, 4096)]
    found += [
        engine("blocks-mixed", "jawari-harp", 0.25, piece, blocks=[5, 32, 1, 700, 64, 33], stems=True),
        *(engine(f"threads-{n}", "jawari-harp", 0.25, piece, options={"threads": n}) for n in (1, 2, 3)),
        *(engine(f"rate-{hz}", "jawari-harp", 0.2, piece, rate_hz=hz) for hz in (44100, 48000, 88200, 96000)),
        engine("rate-bass-96000", "fretted-bass", 0.2, phrase(23, (28, 33, 40), 8, 0.2), rate_hz=96000),
        engine("internal-rate", LIGHT, 0.15, note(0.0, 36, 100, 0.1), options={"internal_rate_hz": 44100 * 7}),
        *(
            engine(
                f"restitution-{law}",
                LIGHT,
                0.1,
                note(0.0, 36, 110, 0.05),
                options={"scheme": law, "restitution": 0.5, "internal_rate_hz": 44100 * 24, "only_notes": [[36]]},
            )
            for law in LAWS[1:]
        ),
        engine("limiter-at-work", "jawari-harp", 0.2, hot, options={"gain_db": 24.0}),
        engine("limiter-off", "jawari-harp", 0.2, hot, options={"gain_db": 24.0, "limiter": False}),
        *(engine(f"economy-{on}", "jawari-harp", 0.25, piece, options={"economy": on == "on"}) for on in ("on", "off")),
        engine("points-body-velocity", {"toml": POINTS}, 0.25, plucks),
        engine("curved-bridge", {"toml": CURVED}, 0.2, plucks),
        engine("curved-bridge-moreau-jean", {"toml": CURVED}, 0.1, plucks, options={"scheme": "moreau-jean"}),
        *(
            engine(f"slapped-bass-{law}", slapped, 0.2, phrase(28, (28, 33, 38, 43), 6, 0.2), options={"scheme": law})
            for law in LAWS
        ),
        engine("points-reference", {"toml": POINTS}, 0.1, plucks, options={"quality": "reference", "only_notes": [[45]]}),
        engine("nothing-to-touch", {"toml": POINTS, "set": {"obstacle": '{ kind = "none" }'}}, 0.25, plucks),
        *(
            engine(f"output-{kind}", {"preset": LIGHT, "set": {"output.kind": kind, "output.gain_db": "10"}}, 0.2, strokes)
            for kind, strokes in (
                (k, phrase(26, (36, 43, 48), 6, 0.2)) for k in ("force", "displacement", "velocity", "pickup")
            )
        ),
        engine("ringing-on", {"preset": "jawari-harp", "set": {"damping.ring_on": "true"}}, 0.2, piece),
        engine("a-thread-pressed-in", {"preset": LIGHT, "set": {"obstacle.jiva_um": "-20"}}, 0.2, note(0.0, 36, 90, 0.1)),
        engine("flying-free", {"preset": LIGHT, "set": {"obstacle.jiva_um": "1000"}}, 0.3, phrase(27, (36, 43), 4, 0.3)),
        engine("two-of-a-kind", [LIGHT, LIGHT], 0.2, [*note(0.0, 36, 90, 0.1), *note(0.01, 36, 60, 0.1, 1)], stems=True),
    ]
    return found


# --- the command line

SCALE = "! just.scl\njust\n12\n16/15\n9/8\n6/5\n5/4\n4/3\n45/32\n3/2\n8/5\n5/3\n9/5\n15/8\n2/1\n"
KEYBOARD = "12\n0\n127\n60\n69\n432.0\n12\n0\n1\nx\n3\n4\n5\n6\n7\n8\n9\n10\n11\n"


def played(rows: list[Row]) -> list[tuple[float, list[int]]]:
    """Events as MIDI messages."""
    found = []
    for at, kind, channel, a, b, _ in rows:
        match kind:
            case "on" | "off" | "control" | "key-pressure":
                status = {"off": 0x80, "on": 0x90, "key-pressure": 0xA0, "control": 0xB0}[kind]
                found.append((at, [status | channel, a, b]))
            case "program":
                found.append((at, [0xC0 | channel, a]))
            case "pressure":
                found.append((at, [0xD0 | channel, b]))
            case "bend":
                found.append((at, [0xE0 | channel, (a + 8192) & 127, (a + 8192) >> 7]))
    return found


def song(name: str, words: str, rows: list[Row], preset: str | None = "jawari-harp", **more: Any) -> Scene:
    """`synth render` of a song to a file of float32, unless the words say otherwise."""
    depth = [] if "--bit-depth" in words else ["--bit-depth", "float"]
    command = ["render", "{folder}/song.mid", "-o", "{folder}/out/out.wav", *depth, *(["-p", preset] if preset else [])]
    tail = [] if "--tail" in words else ["--tail", "0.05"]
    messages = more.pop("messages", []) + played(rows)
    return {"name": name, "kind": "command", "words": command + tail + words.split(), "messages": messages, **more}


def _songs() -> list[Scene]:
    tune = [
        *phrase(31, (40, 43, 47, 52), 8, 0.25),
        *sweep("bend", 0.05, 0.1, [2000, 0]),
        control(0.1, 74, 90),
        control(0.1, 1, 100),
    ]
    bass, hot = phrase(32, (28, 33, 38, 40), 6, 0.25), [row(0.0, "on", 0, key, 127) for key in (40, 44, 47, 52, 56)]
    many = [row(0.0, "program", 0, 33), row(0.0, "program", 1, 10), row(0.0, "program", 2, 104),
            *phrase(33, (28, 33, 38), 4, 0.25), *phrase(34, (48, 55), 4, 0.25, 1),
            *phrase(35, (36, 43), 4, 0.25, 2), *phrase(36, (36, 40), 4, 0.25, 9)]  # fmt: skip
    change = [0xF0, 0x7F, 0x7F, 0x08, 0x02, 0x00, 0x02, 40, 40, 60, 11, 47, 46, 90, 3, 0xF7]
    octave = [0xF0, 0x7E, 0x7F, 0x08, 0x08, 0x03, 0x7F, 0x7F, *(50 + 3 * k for k in range(12)), 0xF7]
    body = "[{frequency_hz=180,q=12,gain_db=2},{frequency_hz=420.5,q=30,gain_db=-6}]"
    jean = "--scheme moreau-jean-filtered --restitution 0.3 --internal-rate 1058400"
    return [
        song("song", "", tune),
        song("song-default-programs", "", many, None),
        song("song-map-stems", "--map 1=fretted-bass,2=none,3=tanpura --stems {folder}/out/stems", many),
        song("song-tail-0", "--tail 0", bass, "fretted-bass"),
        song("song-tail-auto", "--tail auto", bass, "fretted-bass"),
        song("song-start-end", "--start 0.07 --end 0.19 --tail 0", tune),
        song("song-blocks-threads", "--block 37 --threads 2", tune),
        *(song(f"song-rate-{hz}", f"-r {hz}", tune) for hz in (48000, 96000)),
        song("song-16-bit", "--bit-depth 16 --seed 5", tune),
        song("song-24-bit", "--bit-depth 24", tune),
        song("song-limited", "--gain 24", hot),
        song("song-not-limited", "--gain 24 --no-limiter", hot),
        song("song-normalized", "--normalize=-3", tune),
        song("song-normalized-hot", "--normalize=-3 --gain 24", hot),
        song(
            "song-scala",
            "--tuning {folder}/just.scl --kbm {folder}/a432.kbm",
            tune,
            files={"just.scl": SCALE, "a432.kbm": KEYBOARD},
        ),
        song("song-tuned-by-sysex", "", tune, messages=[(0.0, octave), (0.12, change)]),
        song("song-mpe", "--mpe", [*tune, *phrase(37, (45, 50), 4, 0.2, 1), *sweep("bend", 0.0, 0.2, [0, 800, 1600], 1)]),
        song("song-controllers", "--cc 74=pluck.position --cc 1=obstacle.height:-50:20", tune),
        song("song-moreau-jean", jean, bass[:4], "fretted-bass"),
        song("song-settings", "--set pluck.position=0.1 --set obstacle.jiva_um=1 --polyphony 2 --quality draft", tune),
        song("song-body", f"--set body.resonance={body}", tune),
        song("song-tempi", "", tune, tempi=[(0.0, 400_000), (0.1, 900_000), (0.15, 500_001)]),
        song("song-transposed", "--transpose=-5 --fold --fallback fretted-bass", tune, LIGHT),
    ]


def _drones() -> list[Scene]:
    brief = [
        "drone",
        "-o",
        "{folder}/out/out.wav",
        "--bit-depth",
        "float",
        "--cycle",
        "1",
        "--duration",
        "1.1",
        "--fade",
        "0.1",
    ]
    wordings = {
        "drone": "",
        "drone-five-strings": "--strings 5 --first Ma --second Ni --sa D3 --jiva 6 --human 1 --seed 3 --velocity 90",
        "drone-equal-48000": "--tuning equal --cents=-2,0,2,5 --spacing 1,2,1,2 -r 48000 --threads 2",
        "drone-fine": "--quality fine --first 7/4 --seed 9 --gain 6",
    }
    return [{"name": name, "kind": "command", "words": brief + words.split()} for name, words in wordings.items()]


# --- simulate

#: how long each case is run [s]: long enough to touch, short enough to wait for
CASES = {
    "bass": 0.02, "cabannes": 0.035, "flat-wall": 0.02, "flat-wall-points": 0.03, "fretless": 0.015,
    "guitar-pair": 0.5, "ideal-bridge": 0.03,
    "sitar": 0.04, "tanpura": 0.015,
    "hard/bass-x10": 0.03, "hard/bend": 0.19, "hard/critically-damped": 0.02, "hard/five-minutes": 10.0,
    "hard/four-megahertz": 0.002, "hard/fretless": 0.003, "hard/highest-sitar": 0.05, "hard/lowest-bass": 0.1,
    "hard/many-modes": 0.05, "hard/moving-ramp": 0.12, "hard/moving-sine": 0.05, "hard/near-end": 0.1,
    "hard/node-half": 0.05, "hard/node-third": 0.05, "hard/omega-dt": 0.1, "hard/one-mode": 0.3, "hard/overdamped": 0.05,
    "hard/pressed-in": 0.05, "hard/repluck": 0.07, "hard/restitution": 0.006, "hard/tanpura-x10": 0.05,
    "hard/twenty-frets-at-once": 0.02,
    "hard/two-close": 0.05, "hard/undamped-minute": 5.0,
}  # fmt: skip


def simulation(name: str, case: Any, *runs: dict[str, Any], **more: Any) -> Scene:
    return {"name": name, "kind": "simulate", "case": case, "runs": list(runs), **more}


def _cases() -> list[Scene]:
    """Every case as it stands: by blocks without the ledger, by steps with it."""
    return [
        simulation(
            f"case-{case.replace('/', '-')}", case, *({"duration_s": seconds, "ledger": ledger} for ledger in (False, True))
        )
        for case, seconds in CASES.items()
    ]


def _schemes() -> list[Scene]:
    """Every scheme where it applies, with what it can be given."""
    coarse = {"internal_rate_hz": 88200, "output_rate_hz": 44100, "modes": 179, "duration_s": 0.1}
    frets = {"internal_rate_hz": 88200, "output_rate_hz": 44100, "modes": 120, "duration_s": 0.05}
    brief = {**coarse, "duration_s": 0.03}
    found = [simulation(f"quality-{quality}", "tanpura", {"quality": quality, "duration_s": 0.05}) for quality in QUALITIES]
    found.append(simulation("quality-wall", "fretless", {"quality": "draft", "duration_s": 0.03}))
    for law in LAWS:
        for case, at in (("tanpura", coarse), ("bass", frets)):
            runs = [
                {**at, "scheme": law, "restitution": e, "ledger": ledger} for e in (0.0, 0.6) for ledger in (False, True)
            ]
            found.append(simulation(f"scheme-{law}-{case}", case, *(runs[:2] if law == "exact-hold" else runs)))
    for case, at in (("tanpura", coarse), ("bass", frets)):
        tails = [{**at, "tail": tail, "ledger": ledger} for tail in ("lumped", "static", "none") for ledger in (False, True)]
        found.append(simulation(f"tails-{case}", case, *tails))
        found.append(simulation(f"substeps-{case}", case, *({**at, "substeps": k} for k in (2, 3, 4, 8))))
        found.append(
            simulation(f"substeps-ledger-{case}", case, *({**at, "substeps": k, "ledger": True} for k in (2, 3, 4, 8)))
        )
    found.append(
        simulation("start-published", "tanpura", *({**coarse, "scheme": law, "start": "published"} for law in LAWS[1:]))
    )
    for scheme in ("compliant", "energy-quadratisation", "scalar-auxiliary-variable"):
        for case, at in (("tanpura", brief), ("bass", {**frets, "duration_s": 0.02})):
            runs = [{**at, "scheme": scheme, "ledger": ledger} for ledger in (False, True)]
            runs.append({**at, "scheme": scheme, "stiffness": 1e8, "exponent": 2.0})
            if scheme != "scalar-auxiliary-variable":
                runs.append({**at, "scheme": scheme, "loss": 0.3, "ledger": True})
            found.append(simulation(f"scheme-{scheme}-{case}", case, *runs))
    full = {"scheme": "compliant", "grid": "full", "internal_rate_hz": 44100, "modes": 200, "duration_s": 0.01}
    corrected = {**brief, "scheme": "scalar-auxiliary-variable", "drift_correction": 0.5, "ledger": True}
    board = {"scheme": "wall", "internal_rate_hz": 176400, "output_rate_hz": 44100, "modes": 127, "duration_s": 0.02}
    event = {"scheme": "event-driven", "internal_rate_hz": 44100, "modes": 20, "duration_s": 0.05}
    long = {**brief, "duration_s": 0.02, "ledger": True}
    return [
        *found,
        simulation("compliant-full-grid", "tanpura", full),
        simulation("auxiliary-variable-corrected", "tanpura", corrected),
        simulation("scheme-wall", "fretless", *({**board, "restitution": e, "ledger": e < 1.0} for e in (0.0, 0.7, 1.0))),
        simulation(
            "scheme-wall-rigid", "flat-wall", {"scheme": "wall", "restitution": 0.5, "ledger": True, "duration_s": 0.02}
        ),
        simulation("scheme-waveguide", "cabannes", {"scheme": "waveguide"}),
        simulation("scheme-waveguide-bridge", "ideal-bridge", {"scheme": "waveguide"}),
        simulation("scheme-cabannes", "cabannes", {"scheme": "cabannes"}),
        simulation("scheme-flat-wall", "flat-wall", {"scheme": "flat-wall", "duration_s": 0.02}),
        simulation("scheme-event-driven", "tanpura", event, {**event, "tail": "none"}),
        simulation("resumed", "tanpura", long, long, resume=True),
        simulation("resumed-frets", "bass", {**frets, "duration_s": 0.02}, {**frets, "duration_s": 0.02}, resume=True),
    ]
