"""What strings that share a bridge are spared while they touch nothing: modes that rest, float32, tables, certificates."""

import numpy as np
import pytest

from synth.engine import bank, layout
from synth.engine.engine import Engine
from synth.instrument.preset import Preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON
from synth.solver import coupling
from synth.solver.block_rows import BLOCK
from synth.solver.due_responses import ROW_DUE, fill_all_rows
from synth.solver.laws import EXACT_HOLD, coefficients, contact_matrix
from synth.solver.line_certificates import certify_line
from synth.solver.line_tables import ALL_DUE, READY, ensure_tables

from .kit import NECK_OBSTACLE, RATE_HZ, awake, engine, play, preset, steel, wound
from .test_together import HEARD, MODES, ONE_WAY, TWO_WAYS

#: strings over nothing, in two directions, of which the low ones have modes that a body hardly moves for
OPEN = preset(
    "open-two", steel("E2") + steel("A2") + "place_mm = 9\n" + steel("E3") + "place_mm = 20\n", output=HEARD,
    more=MODES + TWO_WAYS,
)  # fmt: skip
#: strings over frets, too far for a soft pluck to reach them
NECK = preset(
    "neck-two", wound("E1", 32.5) + "place_mm = -20\n" + wound("A1", 20.9) + wound("D2", 13.8) + "place_mm = 20\n",
    obstacle=NECK_OBSTACLE, output=HEARD, more=MODES + TWO_WAYS,
)  # fmt: skip
#: unisons with a high string in high modes of two low ones, on a body that is easily moved
LIGHT = preset(
    "light", steel("E2") + steel("B2") + "place_mm = 9\n" + steel("E5") + "place_mm = 20\n", output=HEARD,
    more=MODES.replace("mass_kg = 0.", "mass_kg = 0.0"),
)  # fmt: skip
#: error of coupled strings that touch nothing over 3 s, at `standard`
PROMISED = 1e-3
CHORD = [(5, NOTE_ON, 0, 40, 70), (20_000, NOTE_ON, 0, 45, 50), (50_000, NOTE_OFF, 0, 40)]
#: a wheel that goes up and down by two semitones, twice a second
WHEEL = [(4000 + 441 * k, BEND, 0, round(8191 * np.sin(2.0 * np.pi * 0.02 * k))) for k in range(400)]


def error(sound: np.ndarray, reference: np.ndarray) -> float:
    """e of a sound (Issanchou 2017)."""
    return float(np.sqrt(np.sum((sound - reference) ** 2) / np.sum(reference**2)))


def ends_of(made: Engine) -> list[coupling.End]:
    return made._strings.bridges.ends.items


def address_of(made: Engine) -> int:
    return int(made._strings.bridges.coupling_tables[0].ctypes.data)


def played(instrument: Preset, rows: list, seconds: float = 3.0, **more) -> tuple[Engine, np.ndarray]:
    made = engine(instrument, **more)
    return made, play(made, rows, round(seconds * RATE_HZ))


def test_modes_that_rest_are_not_missed() -> None:
    made, sound = played(OPEN, CHORD, precision="float64")
    resting = [end.counts[coupling.RESTING] and end.counts[coupling.APART_MODES] for end in ends_of(made)]
    heard = [end.counts[coupling.HEARD_MODES] for end in ends_of(made)]
    assert sum(1 for rest, all_of in zip(resting, heard, strict=True) if 0 < rest < 0.7 * all_of) >= 3
    whole = played(OPEN, CHORD, precision="float64", economy=False)[1]
    assert 0.0 < error(sound, whole) < PROMISED


def test_it_is_what_is_felt_that_decides(monkeypatch) -> None:
    """Where the bridge does feel high modes of strings that nobody plays, they do not rest; they would be missed."""
    rows = [(0, NOTE_ON, 0, 76, 100)]
    whole = played(LIGHT, rows, precision="float64", economy=False)[1]
    assert error(played(LIGHT, rows, precision="float64")[1], whole) < PROMISED
    monkeypatch.setattr(bank, "UNFELT", 1e6)
    assert error(played(LIGHT, rows, precision="float64")[1], whole) > 10.0 * PROMISED


def test_a_string_that_is_struck_has_all_its_modes_again() -> None:
    rows = [(0, NOTE_ON, 0, 45, 80), (60_000, NOTE_ON, 0, 40, 110)]
    made = engine(OPEN)
    play(made, rows, 59_968)
    assert ends_of(made)[0].counts[coupling.RESTING] == 1
    play(made, [(32, NOTE_ON, 0, 40, 110)], 3200)
    end = ends_of(made)[0]
    assert end.counts[coupling.RESTING] == 0
    assert end.counts[coupling.APART_MODES] == end.counts[coupling.HEARD_MODES] > end.counts[coupling.FELT_MODES]
    q, v = made._strings.states.items[0].q, made._strings.states.items[0].v
    above = slice(int(end.counts[coupling.FELT_MODES]), int(end.counts[coupling.HEARD_MODES]))
    assert np.abs(q[above]).max() > 0.0 and np.abs(v[above]).max() > 0.0


def test_a_pull_off_moves_all_modes_again() -> None:
    """A fret that is left for a lower one, after the string's high modes have come to rest."""
    rows = [(0, CONTROL, 0, 68, 127), (9, NOTE_ON, 0, 45, 20), (80_000, NOTE_ON, 0, 41, 20), (80_500, NOTE_OFF, 0, 45)]
    made = engine(NECK, precision="float64")
    play(made, rows, 79_968)
    line = int(np.flatnonzero(made._sounding.voices["note"] == 45)[0])
    assert ends_of(made)[line].counts[coupling.RESTING] == 1
    play(made, [(row[0] - 79_968, *row[1:]) for row in rows[2:]], 128)
    assert made._sounding.voices["note"][line] == 41 and ends_of(made)[line].counts[coupling.RESTING] == 0
    sound, whole = (played(NECK, rows, precision="float64", economy=economy)[1] for economy in (True, False))
    assert error(sound, whole) < PROMISED


def test_float32_is_not_missed() -> None:
    single, double = (played(OPEN, CHORD + WHEEL, precision=kind)[1] for kind in ("float32", "float64"))
    assert 0.0 < error(single, double) < 0.1 * PROMISED


@pytest.mark.parametrize("line", [0, 2])
def test_tables_that_waited_are_those_of_the_bend(line: int) -> None:
    """Rows of a step, the contacts' matrix and flight of a line that was bent while it touched nothing."""
    made = engine(NECK)
    play(made, [(0, NOTE_ON, 0, 28, 1), (40, NOTE_ON, 0, 33, 1), (6000, BEND, 0, -5000)], 9600)
    end, string = ends_of(made)[line], made._strings.states.items[line]
    assert end.counts[coupling.ENGAGED] == 0 and end.counts[coupling.DUE] == ALL_DUE
    ensure_tables(address_of(made), line, int(made._thread_table.ctypes.data))
    assert end.counts[coupling.DUE] == READY
    lines = made._strings.bridges.couplings[0].lines
    assert (string.due == ROW_DUE).all()
    fill_all_rows(int(lines.model[line]), int(lines.state[line]))
    model = made._strings.models[made._sounding.hands["model"][line]]
    own, n, contacts = made._strings.coefficients.items[line], model.modes, model.contacts.size
    ratio = 2.0 ** (made._sounding.expressions["bend"][line] / 12.0)
    assert own.omega[0] == pytest.approx(ratio * model.omega[0], rel=1e-9) and ratio < 0.95
    step = coefficients(EXACT_HOLD, own.omega[:n], end.sigma[:n], model.mu, model.dt)
    rows = own.rows[: model.rows.size].reshape(model.rows.shape)
    np.testing.assert_allclose(rows[:6, :n], step, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(
        end.flight[:6, :n],
        coefficients(EXACT_HOLD, own.omega[:n], end.sigma[:n], model.mu, 1.0 / RATE_HZ),
        rtol=1e-8,
        atol=1e-13,
    )
    matrix = np.empty((contacts, contacts))
    under = model.contacts
    contact_matrix(EXACT_HOLD, step, np.ascontiguousarray(under.shapes[:, :n]), under.residual / ratio**2, matrix)
    np.testing.assert_allclose(own.matrix[: contacts**2].reshape(contacts, contacts), matrix, rtol=1e-9)
    assert string.due[:contacts].all()


def test_responses_of_contacts_are_those_of_the_bend_where_they_are_looked_at() -> None:
    """Of a line that is bent over frets: gaps after a kick of its end, and what a force does to the bridge."""
    made = engine(NECK)
    bends = [(1000 + 64 * k, BEND, 0, 60 * k) for k in range(30)]
    seen = 0
    for rows in ([(0, NOTE_ON, 0, 29, 127), (0, NOTE_ON, 0, 34, 120)], *[[(0, *row[1:])] for row in bends]):
        play(made, rows, 64)
        for line, end in enumerate(ends_of(made)):
            if end.counts[coupling.KIND] < coupling.SINGLE or not end.counts[coupling.NEAR]:
                continue
            model = made._strings.models[made._sounding.hands["model"][line]]
            own, n = made._strings.coefficients.items[line], model.modes
            bent = made._sounding.expressions["bend"][line] != 0.0
            rows_of = own.rows[: model.rows.size].reshape(model.rows.shape) if bent else model.rows
            p11, p12, p21, p22, kq, kv = (each[:n] for each in rows_of[:6])
            steps = int(made._strings.bridges.couplings[0].lines.steps[line])
            for c in end.block.near[: end.counts[coupling.NEAR]]:
                assert not end.responses.waits[c]
                shape, lever = model.contacts.shapes[c, :n], end.leverage[c]
                q, v = p12 * end.kick[:n], p22 * end.kick[:n]
                struck_q, struck_v = kq * shape, kv * shape
                pulled = []
                for step in range(BLOCK):
                    moved = shape @ q + lever * model.dt * (step + 1)
                    assert end.responses.moved[c, BLOCK + step] == pytest.approx(moved, rel=1e-7, abs=1e-13)
                    pulled.append(end.pull[:n] @ struck_v)
                    q, v = p11 * q + p12 * v, p21 * q + p22 * v
                    struck_q, struck_v = p11 * struck_q + p12 * struck_v, p21 * struck_q + p22 * struck_v
                for step in range(steps):
                    reach = lever / steps - pulled[steps - 1 - step] / (steps * model.dt)
                    assert end.responses.reach[c, step] == pytest.approx(reach, rel=1e-7, abs=1e-9)
                seen += bent
    assert seen > 20


def test_a_bend_keeps_no_string_awake_to_its_frets() -> None:
    """The strings that nobody bends are certified while another is, and the one that is bent, too."""
    soft = [(0, NOTE_ON, 0, 33, 20)]
    plain, bent = (played(NECK, rows, 2.0)[0] for rows in (soft, soft + WHEEL[:150]))
    for made in (plain, bent):
        assert not any(end.counts[coupling.ENGAGED] for end in ends_of(made))
    assert bent._sounding.expressions["bend"].any()
    steps = [int(made._sounding.tallies["mode_steps"].sum()) for made in (plain, bent)]
    assert steps[1] < 1.1 * steps[0]


def test_a_certificate_that_outlives_a_bend_is_true() -> None:
    """What is left of each clearance is no more than a certificate from the state as it is would say, in every quantum."""
    made = engine(NECK)
    play(made, [(0, NOTE_ON, 0, 33, 25), (7, NOTE_ON, 0, 28, 25)], 4000)
    address, scratch, kept = address_of(made), int(made._thread_table.ctypes.data), 0
    at = 4000
    while at < 60_000:
        rows = [(row[0] - at, *row[1:]) for row in WHEEL if at <= row[0] < at + layout.QUANTUM]
        play(made, rows, layout.QUANTUM)
        at += layout.QUANTUM
        for line, end in enumerate(ends_of(made)):
            contacts = made._strings.models[made._sounding.hands["model"][line]].contacts.size
            if end.counts[coupling.ENGAGED] or contacts == 0 or not end.certificate.clearance[:contacts].any():
                continue
            before = [array.copy() for array in (end.numbers, end.counts, end.certificate.clearance, end.certificate.bound)]
            end.numbers[coupling.SPENT] = 0.0  # all that is clear, without a reserve
            certify_line(address, line, scratch)
            exact = end.certificate.clearance[:contacts].copy()
            for array, old in zip(
                (end.numbers, end.counts, end.certificate.clearance, end.certificate.bound), before, strict=True
            ):
                array[:] = old
            assert np.all(end.certificate.clearance[:contacts] <= exact + 1e-12)
            kept += int(np.any(end.certificate.clearance[:contacts] < exact - 1e-9))
    assert kept > 100


@pytest.mark.parametrize("bends", [WHEEL, []], ids=["bent", "plain"])
def test_it_sleeps_under_a_wheel_that_moves(bends: list) -> None:
    short = preset("short", steel("C5") + steel("G5"), output=HEARD, more=ONE_WAY, damping="release_s = 0.05")
    made = engine(short)
    play(made, [(0, NOTE_ON, 0, 72, 100), (2000, NOTE_OFF, 0, 72)], 4000)
    at = 4000
    while at < 30 * RATE_HZ and any(awake(made)):
        period = 441 * len(WHEEL)
        rows = [(4000 + (row[0] - 4000) % period, *row[1:]) for row in bends]
        play(made, [(row[0] - 4000, *row[1:]) for row in rows], period)
        at += period
    assert not any(awake(made))
