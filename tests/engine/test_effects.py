"""Effects in an engine: where they stand, what they hear, and that nothing else is heard of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter

from synth.dsp.effect import Effect, check_state
from synth.engine.effect_chains import MOST_LATENCY
from synth.engine.layout import CHECK_EVERY
from synth.instrument.effects import EffectTable, effect_of, register
from synth.instrument.preset import PresetError, parse_preset
from synth.instrument.presetfile import preset_text
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from tests.engine.kit import FREE, QUANTUM, RATE_HZ, engine, go_on_from, play, preset, steel, what_sounds
from tests.engine.tremor import TREMOR, Tremor, shape

NOTES = [(0, NOTE_ON, 0, 50, 100), (3000, NOTE_ON, 0, 48, 80), (5000, NOTE_OFF, 0, 50)]
STRINGS = steel("C3-E3") + steel("G3")


#: frames after which strings are looked at in the same way again
CHECKS = QUANTUM * CHECK_EVERY


def trembling(more: str = "", **settings: float) -> object:
    """FREE, through a tremor."""
    rows = {"period_ms": 90.0, **settings}
    text = "\n".join(f"{key} = {value}" for key, value in rows.items())
    return preset("trembling", STRINGS, more=f'{more}\n[[effect]]\nkind = "tremor"\n{text}')


def test_an_effect_hears_the_part_and_nothing_else():
    """Before the high-pass a part is what the twin says, from its first quantum with sound on; the other is as it was."""
    events = [*NOTES, (0, NOTE_ON, 1, 52, 90)]
    plain, made = engine(FREE, FREE), engine(trembling(), FREE)
    stems, through = np.zeros((2, 2, 20000, 2))
    play(plain, events, 20000, stems=stems)
    play(made, events, 20000, stems=through)
    assert np.array_equal(stems[1], through[1])
    assert made.latency_samples == plain.latency_samples
    pole = plain.memory.settings.dc
    heard = lfilter([1.0, -pole], [1.0, -1.0], stems[0, :, 0])
    begin = int(np.flatnonzero(heard)[0]) // QUANTUM * QUANTUM
    gain = shape(np.maximum(np.arange(20000) - begin, 0), Tremor(kind="tremor", period_ms=90.0), RATE_HZ)
    expected = lfilter([1.0, -1.0], [1.0, -pole], gain * heard)
    np.testing.assert_allclose(through[0, :, 0], expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())
    assert np.ptp(gain) == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("blocks", [1, 37, 64, 4096])
def test_block_size_changes_no_bit(blocks):
    made = engine(trembling(late_frames=50), FREE, limiter=True, mix_effects=[Tremor(kind="tremor", period_ms=31.0)])
    events = [*NOTES, (100, NOTE_ON, 1, 55, 127), (9000, CONTROL, 0, 120, 0), (30000, NOTE_ON, 0, 52, 127)]
    whole = play(made, events, 40000, 512)
    made.reset()
    count = 40000 if blocks > 1 else 6000
    assert np.array_equal(play(made, events, count, blocks), whole[:count])


def test_parts_stay_in_time_with_one_that_is_late():
    plain, made = engine(FREE, FREE), engine(trembling(late_frames=50, depth=0.0), FREE)
    assert made.latency_samples == plain.latency_samples + 50
    events = [(0, NOTE_ON, 0, 50, 100), (0, NOTE_ON, 1, 52, 100)]
    stems, late = np.zeros((2, 2, 8050, 2))
    out = play(plain, events, 8050, stems=stems)
    delayed = play(made, events, 8050, stems=late)
    for part in range(2):
        assert np.array_equal(late[part, 50:], stems[part, :-50])
    assert np.array_equal(delayed[50:], out[:-50])


def test_effects_of_the_mix_stand_before_the_limiter_and_stems_before_them():
    table = Tremor(kind="tremor", period_ms=31.0, depth=0.0, late_frames=40)
    plain, made = engine(FREE, limiter=True), engine(FREE, limiter=True, mix_effects=[table])
    assert made.latency_samples == plain.latency_samples + 40
    stems, late = np.zeros((2, 1, 6040, 2))
    out = play(plain, NOTES, 6040, stems=stems)
    delayed = play(made, NOTES, 6040, stems=late)
    assert np.array_equal(delayed[40:], out[:-40]) and np.array_equal(late[:, 40:], stems[:, :-40])
    with pytest.raises(ValueError, match=f"the mix effects may add up to {MOST_LATENCY} frames of latency, got 264"):
        engine(FREE, limiter=True, mix_effects=[table.model_copy(update={"late_frames": 200})])
    for wrong in ("tremor", [TREMOR], 5):
        with pytest.raises(TypeError, match="mix_effects must be a list of effect settings"):
            engine(FREE, mix_effects=wrong)


def test_a_silent_part_forgets_and_begins_anew():
    made = engine(trembling(late_frames=50))
    first = play(made, [(0, NOTE_ON, 0, 50, 100)], 8192)
    play(made, [(0, CONTROL, 0, 120, 0)], 5 * 44100 // CHECKS * CHECKS)
    assert made.silent and made._state.part_state["still"][0] == 1
    assert not made._stream.effect_numbers.any() and not made._stream.effect_counts.any()
    assert np.array_equal(play(made, [(0, NOTE_ON, 0, 50, 100)], 8192), first)


def test_an_effect_goes_on_from_what_it_holds():
    made = engine(trembling(late_frames=50), mix_effects=[Tremor(kind="tremor", period_ms=31.0)], limiter=True)
    play(made, NOTES, 4000)
    state = what_sounds(made)
    rest = play(made, [], 6000)
    go_on_from(made, state)
    assert np.array_equal(play(made, [], 6000), rest)


def test_whatever_gets_into_an_effect_ends_there():
    made = engine(trembling(late_frames=50))
    play(made, NOTES, 6400)
    made._stream.effect_numbers[:51] = math.nan
    stems = np.zeros((1, 6400, 2))
    assert np.isfinite(play(made, [], 6400, stems=stems)).all() and np.isfinite(stems).all()
    assert made.report().silenced == 1 and np.isfinite(made._stream.effect_numbers).all()


# --- in a preset's file ---


def effect(text: str) -> str:
    return f'format = 2\nname = "x"\n{STRINGS}\n[pluck]\ndisplacement_mm = 2.0\n{text}'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[[effect]]\nkind = "tremmor"\n',
            r"effect\.0\.kind: an effect named 'tremmor' is not known \(perhaps tremor\?\); known: .*tremor",
        ),
        ("[[effect]]\nperiod_ms = 5.0\n", r"effect\.0\.kind: missing"),
        ("[[effect]]\nkind = 5\n", r"effect\.0\.kind: must be text, got 5"),
        ('[[effect]]\nkind = "tremor"\n', r"effect\.0\.period_ms: missing"),
        (
            '[[effect]]\nkind = "tremor"\nperiod_ms = 10.0\n[[effect]]\nkind = "tremor"\nperiod_ms = 0.5\n',
            r"effect\.1\.period_ms: must be greater than or equal to 1, got 0\.5",
        ),
        (
            '[[effect]]\nkind = "tremor"\nperiod_ms = 10.0\ndeepth = 0.5\n',
            r"effect\.0\.deepth: no such key \(perhaps depth\?\)",
        ),
    ],
)
def test_wrong_effects_are_refused_by_their_names(text, said):
    with pytest.raises(PresetError, match=said):
        parse_preset(effect(text), "x")


def test_all_that_is_wrong_is_said_at_once():
    text = effect('[[effect]]\nkind = "tremor"\nperiod_ms = 0.5\ndepth = 2.0\n').replace("2.0\n", "-1.0\n", 1)
    with pytest.raises(PresetError) as caught:
        parse_preset(text, "x")
    assert [path for path, _ in caught.value.problems] == ["pluck.displacement_mm", "effect.0.period_ms", "effect.0.depth"]


def test_an_effect_that_is_no_table_is_refused():
    with pytest.raises(PresetError, match=r"effect\.0: "):
        parse_preset(effect("").replace("name =", "effect = [5]\nname ="), "x")
    with pytest.raises(PresetError, match="effect: must be a list"):
        parse_preset(effect("").replace("name =", "effect = 5\nname ="), "x")


def test_a_preset_with_effects_is_written_and_changed():
    made = trembling(depth=0.25)
    assert parse_preset(preset_text(made), "again") == made
    assert type(made).model_validate(made.model_dump()) == made
    assert made.with_setting("effect.0.depth", "0.5").effect == (Tremor(kind="tremor", period_ms=90.0, depth=0.5),)
    with pytest.raises(PresetError, match=r"effect\.0\.depth: must be less than or equal to 1"):
        made.with_setting("effect.0.depth", "2")


# --- the registry ---


def test_what_may_be_registered():
    assert effect_of("tremor") is TREMOR and register(TREMOR) is TREMOR
    with pytest.raises(ValueError, match="there is an effect 'tremor' already"):
        register(replace(TREMOR, latency=lambda made: 1))
    with pytest.raises(ValueError, match="name of an effect must be lower-case letters"):
        register(replace(TREMOR, kind="Tre mor"))
    with pytest.raises(TypeError, match="must be a subclass of EffectTable"):
        register(replace(TREMOR, kind="other", settings=dict))
    assert issubclass(TREMOR.settings, EffectTable)


class Odd(NamedTuple):
    numbers: Any


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (np.zeros(3, np.float32), r"numbers of its state must be an array of float64 or int64, got array\("),
        (0.5, "numbers of its state must be an array of float64 or int64, got 0.5"),
    ],
)
def test_states_that_cannot_be_kept_are_refused(numbers, said):
    effect = Effect("odd", TREMOR.made, TREMOR.at_rest, TREMOR.process, TREMOR.silent)
    with pytest.raises(TypeError, match=f"odd: {said}"):
        check_state(effect, Odd(numbers))
    check_state(effect, Odd(np.zeros(3)))
    check_state(effect, Odd(np.zeros(3, np.int64)))
