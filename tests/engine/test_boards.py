"""Strings over a board, as the engine plays them: fingers that slide, bends, re-plucks, states, blocks, threads."""

import itertools

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import PresetError, parse_preset
from synth.midi.events import BEND, CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE
from synth.solver.board_table import SPEAKING, STRUCK, Board
from synth.solver.stringmodel import FREE as REACHES_NOTHING
from synth.solver.stringmodel import MOVING

from .kit import (
    FREE,
    RATE_HZ,
    awake,
    bank_of,
    engine,
    go_on_from,
    model_of,
    place,
    play,
    preset,
    random_events,
    string_of,
    what_sounds,
    wound,
)

PICKUP = 'kind = "pickup"\nposition = 0.12\ndistance_mm = 5\naperture_mm = 12\ngain_db = -18'
OBSTACLE = (
    'kind = "board"\nsemitones = 14\nlength_mm = 600\naction_12th_mm = 1.0\nnut_height_mm = 0.15\ntip_loss_n_s_m = 0.5'
)
#: one string, notes 33…47
ONE = preset("one-board", wound("A1", 20.9), obstacle=OBSTACLE, output=PICKUP, polyphony=1)
#: two strings, notes 33…52
BOARD = preset(
    "board", wound("A1", 20.9) + wound("D2", 13.8), obstacle=OBSTACLE, output=PICKUP, polyphony=2,
    pluck="velocity_exponent = 1.0", more="pressure_cents = 40\n",
)  # fmt: skip
ROWS = [
    (3, NOTE_ON, 0, 33, 127), (700, NOTE_ON, 0, 40, 127), (1400, NOTE_ON, 0, 36, 120), (2200, CONTROL, 0, 68, 127),
    (2300, NOTE_ON, 0, 45, 100), (2311, PRESSURE, 0, 90), (2900, NOTE_OFF, 0, 36), (3333, BEND, 0, 8191),
    (3700, PARAMETER, 0, layout.HEIGHT, 0, 40.0), (4000, NOTE_ON, 0, 42, 127), (4500, NOTE_ON, 0, 44, 127),
    (4550, KEY_PRESSURE, 0, 44, 90), (4600, NOTE_ON, 0, 46, 127), (5200, NOTE_OFF, 0, 33), (6000, BEND, 0, -4000),
]  # fmt: skip


def board_of(made: Engine, s: int = 0) -> Board:
    """The board under string s as it is stopped."""
    model = int(made._sounding.hands["model"][s])
    (found,) = [b for b, m in zip(made._strings.boards.items, made._strings.boards.models, strict=True) if model in m]
    return found


def struck(made: Engine) -> int:
    return sum(int(each.counts[STRUCK]) for each in made._strings.boards.items)


def omega_of(made: Engine, s: int = 0) -> np.ndarray:
    """(N,) of a string as it is now."""
    if not made._sounding.motions["altered"][s]:
        return model_of(made, s).omega
    return made._strings.coefficients.items[s].omega[: model_of(made, s).modes]


def test_it_sounds_and_strikes_the_board() -> None:
    made = engine(BOARD)
    out = play(made, [(0, NOTE_ON, 0, 40, 127)], 8192)
    assert 0.01 < np.abs(out).max() < 4.0 and struck(made) > 10
    soft = engine(BOARD)
    play(soft, [(0, NOTE_ON, 0, 40, 10)], 8192)
    assert struck(soft) == 0


@pytest.mark.parametrize("blocks", [1, 7, 100, 4096])
def test_any_block_size_and_threads_give_the_same_bits(blocks: int) -> None:
    frames = 2100 if blocks == 1 else 7000
    wanted = play(engine(BOARD, threads=1), ROWS, frames)
    assert np.array_equal(wanted, play(engine(BOARD, threads=2 if blocks == 100 else 1), ROWS, frames, blocks))


@pytest.mark.parametrize("at", [40, 900, 2305, 3400, 4603])
def test_a_saved_state_goes_on_bit_for_bit(at: int) -> None:
    made = engine(BOARD)
    wanted = play(made, ROWS, 7000)
    first = engine(BOARD)
    play(first, [row for row in ROWS if row[0] < at], at)
    other = engine(BOARD)
    go_on_from(other, what_sounds(first))
    rest = [(row[0] - at, *row[1:]) for row in ROWS if row[0] >= at]
    assert np.array_equal(wanted[at:], play(other, rest, 7000 - at, 300))


@pytest.mark.parametrize(("bend", "semitones"), [(8191, 2.0 * 8191 / 8192), (-4096, -1.0), (2048, 0.5)])
def test_a_bend_slides_the_finger(bend: int, semitones: float) -> None:
    made = engine(ONE)
    play(made, [(0, NOTE_ON, 0, 38, 90)], 3200)
    before, length = omega_of(made)[0], board_of(made).numbers[SPEAKING]
    play(made, [(0, BEND, 0, bend)], 8192)
    assert omega_of(made)[0] / before == pytest.approx(2.0 ** (semitones / 12.0), rel=1e-9)
    # the length alone does it: shorter by the same ratio, but for what stiffness and fingertip do to the first mode
    assert length / board_of(made).numbers[SPEAKING] == pytest.approx(2.0 ** (semitones / 12.0), rel=3e-3)
    play(made, [(0, BEND, 0, 0)], 16384)
    assert board_of(made).numbers[SPEAKING] == length and omega_of(made)[0] == before


def test_where_no_finger_reaches_the_tension_bends() -> None:
    made = engine(ONE)
    play(made, [(0, NOTE_ON, 0, 33, 90)], 1600)
    opened = bank_of(made).models["length"][made._sounding.hands["model"][0]]
    play(made, [(0, BEND, 0, -8192)], 8192)
    assert board_of(made).numbers[SPEAKING] == opened  # an open string has no finger to slide
    assert omega_of(made)[0] / model_of(made, 0).omega[0] == pytest.approx(2.0 ** (-2.0 / 12.0), rel=1e-6)
    play(made, [(0, BEND, 0, 8191)], 8192)
    assert board_of(made).numbers[SPEAKING] < 0.9 * opened  # …but one may be laid on


def test_heights_are_those_of_the_note_stopped_there() -> None:
    """A finger that has slid to a note stands as one that was put there; the output sees the string as there."""
    slid, put = engine(ONE), engine(ONE)
    play(slid, [(0, NOTE_ON, 0, 36, 60), (0, BEND, 0, 4096)], 12000)
    play(put, [(0, NOTE_ON, 0, 37, 60)], 12000)
    one, other = board_of(slid), board_of(put)
    assert one.eta.size == other.eta.size
    # what the fingertip's spring shifts the pitch by is not quite what stiffness would: a tenth of a millimetre
    assert one.numbers[SPEAKING] == pytest.approx(other.numbers[SPEAKING], abs=3e-4)
    near = (one.eta > -1.0) & (other.eta > -1.0)
    assert np.abs(one.eta - other.eta)[near].max() < 2e-6
    n = 20
    assert np.abs(one.weights[:, :n] - other.weights[:, :n]).max() < 2e-3 * np.abs(other.weights[:, :n]).max()
    assert omega_of(slid)[:n] == pytest.approx(omega_of(put)[:n], rel=1e-3)


def test_a_legato_note_slides_there() -> None:
    made = engine(ONE)
    play(made, [(0, NOTE_ON, 0, 36, 110)], 6400)
    before, q = omega_of(made)[0], string_of(made, 0).q.copy()
    play(made, [(0, CONTROL, 0, 68, 127), (0, NOTE_ON, 0, 41, 110)], 64)
    assert place(made, 0)[1] == 8 and made._sounding.hands["phase"][0] == layout.NO_FINGER
    # it is about to set out: it never sounds the new note first
    assert 1.0 <= omega_of(made)[0] / before < 1.05
    way = []
    for _ in range(400):  # twelve time constants
        play(made, [], 32)
        way.append(float(omega_of(made)[0]))
    assert all(b >= a for a, b in itertools.pairwise(way))
    assert way[-1] / before == pytest.approx(2.0 ** (5.0 / 12.0), rel=1e-4)
    assert made._sounding.expressions["slide"][0] == 0.0
    assert np.abs(string_of(made, 0).q).max() > 0.01 * np.abs(q).max()  # the same vibration


def test_without_a_slide_time_and_from_an_open_string_it_is_hammered_on() -> None:
    hammered = parse_preset(_text(OBSTACLE + "\nslide_ms = 0"), "hammered")
    for given, first in ((hammered, 36), (ONE, 33)):
        made = engine(given)
        play(made, [(0, NOTE_ON, 0, first, 110)], 6400)
        play(made, [(0, CONTROL, 0, 68, 127), (0, NOTE_ON, 0, 41, 110)], 64)
        assert made._sounding.hands["phase"][0] == layout.PRESS
        play(made, [], 6400)
        assert place(made, 0)[1] == 8


def _text(obstacle: str, more: str = "") -> str:
    strings = wound("A1", 20.9)
    return f"""format = 2
name = "hammered"
{strings}
[obstacle]
{obstacle}
[pluck]
displacement_mm = 2.0
position = 0.3
[output]
{PICKUP}
{more}
"""


def test_a_raised_board_touches_more_and_gives_no_energy() -> None:
    """Raised by the live parameter under a sounding string; its motion never grows."""
    made = engine(ONE)
    play(made, [(0, NOTE_ON, 0, 38, 60)], 3200)
    count = struck(made)
    energies = []
    for k in range(60):
        play(made, [(0, PARAMETER, 0, layout.HEIGHT, 0, min(50.0, k * 2.0))], 32)
        model, string = model_of(made, 0), string_of(made, 0)
        moving = 0.5 * model.mu * float(np.sum(string.v**2 + (model.omega * string.q) ** 2))
        board = board_of(made)
        held = model.mu * board.numbers[SPEAKING] / board.half.size * float(board.account.sum())
        energies.append(moving + held)
    assert all(b <= a * (1.0 + 1e-12) for a, b in itertools.pairwise(energies))
    assert struck(made) > count


def test_a_quiet_string_flies_and_sleeps_and_wakes() -> None:
    made = engine(BOARD)
    play(made, [(0, NOTE_ON, 0, 36, 20)], 44100)
    assert made._sounding.motions["flying"][0] == 1
    play(made, [(0, NOTE_OFF, 0, 36)], 44100)
    assert awake(made) == []
    again = play(made, [(0, NOTE_ON, 0, 36, 20)], 22050)
    assert np.abs(again).max() > 1e-3


def test_a_string_that_reaches_nothing_under_a_moving_wheel_is_not_looked_at() -> None:
    """…and sounds as one that is; where the wheel brings the board nearer it is looked at again."""
    rows = [(0, NOTE_ON, 0, 40, 20)]
    rows += [(6000 + 176 * k, BEND, 0, round(8000 * np.sin(0.05 * k))) for k in range(120)]
    free, looked = engine(ONE), engine(ONE)
    strings = [string_of(each, 0) for each in (free, looked)]
    sides: list[list[np.ndarray]] = [[], []]
    was_free = 0
    for at in range(0, 32_000, 32):
        due = [(row[0] - at, *row[1:]) for row in rows if at <= row[0] < at + 32]
        for made, side in zip((free, looked), sides, strict=True):
            side.append(play(made, due, 32, 32))
        if at > 7000:
            was_free += int(strings[0].counts[REACHES_NOTHING])
            if not looked._sounding.motions["flying"][0]:
                strings[1].counts[REACHES_NOTHING] = 0
                strings[1].counts[MOVING] = model_of(looked, 0).modes
    assert was_free > 600
    one, other = (np.concatenate(side) for side in sides)
    assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()
    for lift, reaches_nothing in ((0.0, 1), (2000.0, 0)):
        raised = engine(ONE)
        play(raised, [(0, NOTE_ON, 0, 40, 45)], 2000)
        string = string_of(raised, 0)
        for block in range(1000):  # until it has just come to reach nothing
            if string.counts[REACHES_NOTHING]:
                break
            play(raised, [(0, BEND, 0, 100 + block % 50 * 20)], 32, 32)
        assert string.counts[REACHES_NOTHING] == 1
        play(raised, [(0, PARAMETER, 0, layout.HEIGHT, 0, lift)], 32)
        for bend in range(300, 310):
            play(raised, [(0, BEND, 0, bend)], 32, 32)
        assert string.counts[REACHES_NOTHING] == reaches_nothing


def test_a_flight_sounds_as_no_flight() -> None:
    rows = [(0, NOTE_ON, 0, 36, 25), (30000, BEND, 0, 2000), (36000, NOTE_ON, 0, 40, 120)]
    flown, looked = play(engine(BOARD), rows, 44100), play(engine(BOARD, economy=False), rows, 44100)
    assert np.abs(flown - looked).max() < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_wild_players(seed: int) -> None:
    made = engine(BOARD, FREE)
    events = random_events(np.random.default_rng(seed), 300, 40000, 2, (28, 60))
    out = play(made, events, 40000)
    report = made.report()
    assert np.isfinite(out).all() and report.unsolved_contacts == 0 and not made._sounding.tallies["silenced"].any()


def test_models_are_of_one_rate_and_as_fine_as_they_are_long() -> None:
    made = engine(BOARD)
    models = bank_of(made).models
    spacing = models["length"] / (models["own"] + 1)
    assert spacing.max() / spacing.min() < 2.0 + 1e-9
    assert made.rate_hz == RATE_HZ


@pytest.mark.parametrize(
    ("obstacle", "said"),
    [
        (OBSTACLE.replace("600", "300"), "end between half way and the saddle"),
        (OBSTACLE.replace("semitones = 14", "semitones = 30"), "must reach to"),
        (OBSTACLE + "\nrelief_mm = 5", "below the string at rest"),
        (OBSTACLE.replace("semitones = 14", "semitones = 0"), "semitones"),
    ],
)
def test_boards_that_cannot_be_are_refused(obstacle: str, said: str) -> None:
    with pytest.raises(PresetError, match=said):
        engine(parse_preset(_text(obstacle), "hammered"))


def test_other_schemes_and_bodies_are_refused() -> None:
    with pytest.raises(PresetError, match="a board has a contact law of its own"):
        engine(BOARD, scheme="moreau-jean")
    mode = "[[body.mode]]\nfrequency_hz = 100\nq = 20\nmass_kg = 1"
    text = _text(OBSTACLE, mode).replace(PICKUP, 'kind = "body"')
    with pytest.raises(PresetError, match="needs strings with fixed ends"):
        parse_preset(text, "hammered")
