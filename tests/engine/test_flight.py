"""Free flight at the output rate: the same sound as at the internal rate, at every change from one to the other."""

import numpy as np
import pytest

from synth.dsp.decimator import design, response
from synth.engine import bank
from synth.engine.layout import HEIGHT
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER
from tests.engine.kit import NECK_OBSTACLE, ONE_NECK, RATE_HZ, engine, play, preset, steel, wound

#: nothing to touch, at six times the output rate, by each kind of output
OUTPUTS = {
    "force": 'kind = "force"\nposition = 0.012\ngain_db = -6',
    "displacement": 'kind = "displacement"\nposition = 0.1\ngain_db = 50',
    "velocity": 'kind = "velocity"\nposition = 0.1',
    "pickup": 'kind = "pickup"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12',
}
NECK_WITH_PICKUP = preset(
    "picked", wound("G2", 6.69), obstacle=NECK_OBSTACLE, output=OUTPUTS["pickup"] + "\ngain_db = -18", polyphony=1
)


def both(chosen, events, frames, **more):
    """Outputs without and with economy, left channel, and the engine with."""
    made = [engine(chosen, economy=e, **more) for e in (False, True)]
    outs = [play(m, events, frames)[:, 0] for m in made]
    return outs[0], outs[1], made[1]


def worst(a, b):
    """Largest difference over the largest sample, whole and of what lies below 19 kHz."""
    difference = b - a
    spectrum = np.fft.rfft(difference)
    spectrum[np.fft.rfftfreq(difference.size, 1.0 / RATE_HZ) > 19e3] = 0.0
    peak = np.abs(a).max()
    return np.abs(difference).max() / peak, np.abs(np.fft.irfft(spectrum, difference.size)).max() / peak


@pytest.mark.parametrize("kind", OUTPUTS)
def test_every_output_flies(kind):
    """−105 dB below 19 kHz; above it what the decimator's transition band does to a fading tone near 22 kHz: −90 dB, more
    where the output has more of such tones, a velocity (−68 dB) and a pickup (−80 dB)."""
    chosen = preset("free", steel("C3"), output=OUTPUTS[kind])
    a, b, made = both(chosen, [(0, NOTE_ON, 0, 48, 90)], 40000, internal_rate_hz=6 * RATE_HZ)
    assert made._sounding.motions["flying"][0] == 1
    whole, low = worst(a, b)
    assert whole < {"velocity": 4e-4, "pickup": 1e-4}.get(kind, 3e-5), whole
    assert low < 6e-6, low


@pytest.mark.parametrize(
    "change",
    [
        (NOTE_ON, 0, 48, 70),
        (NOTE_OFF, 0, 48, 0),
        (BEND, 0, 3000, 0),
        (CONTROL, 0, 120, 0),
    ],
)
def test_touching_down_for_anything(change):
    """A second pluck, a damping hand, a bend, a cut: at frames in and out of line with quanta."""
    chosen = preset("free", steel("C3"), output=OUTPUTS["force"])
    for frame in (9600, 9601, 9631):
        events = [(0, NOTE_ON, 0, 48, 90), (frame, *change)]
        a, b, _ = both(chosen, events, 30000, internal_rate_hz=6 * RATE_HZ)
        _, _, before = both(chosen, events[:1], frame, internal_rate_hz=6 * RATE_HZ)
        assert before._sounding.motions["flying"][0] == 1
        whole, low = worst(a, b)
        assert whole < 3e-5 and low < 6e-6, (frame, whole, low)


def test_changes_while_the_last_one_fades(monkeypatch):
    """A pluck, a bend or a damping hand some frames after a take-off, closer than FADE, and another soon after."""
    chosen = preset("free", steel("C3"), output=OUTPUTS["force"])
    pluck = [(0, NOTE_ON, 0, 48, 90)]
    probe = engine(chosen, internal_rate_hz=4 * RATE_HZ)
    frames = 0
    while not probe._sounding.motions["flying"][0]:  # in blocks of a quantum, so that take-off is known to a quantum
        play(probe, pluck if frames == 0 else [], 32, 32)
        frames += 32
    assert probe._sounding.motions["fade_at"][0] == 32  # of a quantum that was computed a quantum ago
    taken_off = frames - 2 * 32
    for offset in (1, 10, 25, 40):
        at = taken_off + offset
        for change in ((NOTE_ON, 0, 48, 60), (BEND, 0, 1500, 0), (CONTROL, 0, 120, 0)):
            events = [*pluck, (at, *change), (at + 30, NOTE_ON, 0, 48, 50)]
            plain = play(engine(chosen, economy=False, internal_rate_hz=4 * RATE_HZ), events, 20000)[:, 0]
            lossy = engine(chosen, internal_rate_hz=4 * RATE_HZ)
            with monkeypatch.context() as patched:  # no mode ends at take-off: the changes alone
                patched.setattr(bank, "STOPBAND_EDGE", 100.0)
                whole = engine(chosen, internal_rate_hz=4 * RATE_HZ)
            largest, low = worst(plain, play(whole, events, 20000)[:, 0])
            assert largest < 6e-5 and low < 1e-5, (offset, change, largest, low)
            # a finger that comes within milliseconds would have felt the modes that the decimator stops: −60 dB
            assert worst(plain, play(lossy, events, 20000)[:, 0])[0] < 1e-3, (offset, change)


@pytest.mark.parametrize("chosen", [ONE_NECK, NECK_WITH_PICKUP], ids=["force", "pickup"])
def test_a_soft_note_over_frets_and_a_press(chosen):
    """Above the frets all the time; then pressed to another fret from flight, and let go of to a lower one."""
    events = [(0, NOTE_ON, 0, 45, 30), (12000, NOTE_ON, 0, 47, 30), (24000, NOTE_ON, 0, 43, 30)]
    a, b, made = both(chosen, events, 36000)
    whole, _ = worst(a, b)
    assert whole < 2e-4, whole
    assert made.mode_steps < 0.6 * engine_work(chosen, events)


def engine_work(chosen, events):
    made = engine(chosen, economy=False)
    play(made, events, 36000)
    return made.mode_steps


def test_a_raised_bridge_ends_flight():
    """A string that flew over a low bridge touches it when it comes up."""
    low = preset("low", steel("G2"), obstacle='kind = "bridge"\ndistance_mm = 6.0\njiva_um = 50.0', output=OUTPUTS["force"])
    events = [(0, NOTE_ON, 0, 43, 12), (20000, PARAMETER, 0, HEIGHT, 0, 48.0)]
    a, b, made = both(low, events, 40000, internal_rate_hz=4 * RATE_HZ)
    _, _, before = both(low, events[:1], 20000, internal_rate_hz=4 * RATE_HZ)
    assert before._sounding.motions["flying"][0] == 1 and made._sounding.motions["flying"][0] == 0
    whole, _ = worst(a[:20000], b[:20000])
    assert whole < 3e-5, whole
    # contact makes more of the −90 dB that the change had cost
    assert np.sqrt(np.mean((a - b) ** 2)) < 1e-4 * np.sqrt(np.mean(a**2))


def test_flight_needs_less_work_and_any_block_is_the_same():
    events = [(0, NOTE_ON, 0, 45, 60), (7001, NOTE_ON, 0, 45, 60), (7040, BEND, 0, 900, 0), (9000, BEND, 0, 0, 0)]
    runs = []
    for blocks in (4096, 64, 33):
        made = engine(NECK_WITH_PICKUP)
        runs.append(play(made, events, 30000, blocks))
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])
    rate_factor = made._bank.strings["factor"][0]
    assert rate_factor > 1
    before = made.mode_steps
    play(made, [], 4096)
    assert 0 < made.mode_steps - before <= 4096 * made._bank.models["audible"].max()


def test_response_is_that_of_the_taps():
    """Against the transform of the taps; 1 in the passband, nothing in the stopband."""
    taps = design(44100.0, 3)
    frequency = np.array([0.0, 1e3, 19.9e3, 22.05e3, 24.2e3, 40e3])
    n = np.arange(taps.size) - taps.size // 2
    expected = [np.sum(taps * np.exp(-2j * np.pi * f / 132300.0 * n)).real for f in frequency]
    got = response(44100.0, 3, frequency)
    np.testing.assert_allclose(got, expected, atol=1e-14)
    np.testing.assert_allclose(got[:3], 1.0, atol=2e-5)
    assert abs(got[3] - 0.5) < 1e-3 and np.abs(got[4:]).max() < 1e-5
    np.testing.assert_array_equal(response(44100.0, 1, frequency), np.ones(6))
