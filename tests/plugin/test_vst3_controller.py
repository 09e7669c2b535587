"""VST 3: what hosts see of the plugin before it sounds."""

from __future__ import annotations

import ctypes as c
import math

import numpy as np
import pytest

from synth.engine import layout
from synth.plugin.bankfile import uid_of
from synth.plugin.description import describe

from . import vst3host as host
from .songs import PRESETS, RATES_HZ, engine_of

ABOUT = describe(PRESETS)
CAN_AUTOMATE, READ_ONLY, IS_LIST, IS_HIDDEN, IS_PROGRAM, IS_BYPASS = 1, 1 << 1, 1 << 3, 1 << 4, 1 << 15, 1 << 16


def test_the_factory_makes_one_instrument(factory):
    about = factory.about()
    assert (bytes(about.cid), about.name, about.category) == (uid_of(ABOUT.id), ABOUT.name, b"Audio Module Class")
    assert about.sub == b"Instrument|Synth"
    assert factory.create(bytes(16)) is None
    assert factory.create(bytes(about.cid), bytes(range(16))) is None


def test_a_library_without_a_bank_gives_no_factory(library_file):
    with pytest.raises(ValueError, match="no factory"):
        host.Factory(library_file)


def test_interfaces_lead_to_each_other(instance):
    all_of_them = (
        host.COMPONENT,
        host.PROCESSOR,
        host.CONTROLLER,
        host.MAPPING,
        host.UNITS,
        host.EXPRESSIONS,
        host.REQUIREMENTS,
        host.UNKNOWN,
    )
    for iid in all_of_them:
        face = instance.component.query(iid)
        assert face is not None
        for other in all_of_them:
            back = face.query(other)
            assert back is not None
            back.release()
        assert face.query(bytes(range(16))) is None
        face.release()


def test_buses(instance):
    assert instance.buses(host.EVENT, host.INPUT) == 1 == instance.buses(host.AUDIO, host.OUTPUT)
    assert instance.buses(host.EVENT, host.OUTPUT) == 0 == instance.buses(host.AUDIO, host.INPUT)
    for speakers, said in ((3, host.OK), (1, host.FALSE)):
        given = (c.c_uint64 * 1)(speakers)
        arranged = instance.processor.call(
            3, c.c_int32, (c.c_void_p, None), (c.c_int32, 0), (c.c_void_p, c.addressof(given)), (c.c_int32, 1)
        )
        assert arranged == said


def test_rates(instance, capfd):
    for rate_hz in RATES_HZ:
        instance.start(rate_hz)
        instance.processing(False)
        instance.active(False)
    assert instance.setup(22050.0) == host.FALSE
    assert "22050 Hz is no sample rate of this plugin; it has 44100, 48000" in capfd.readouterr().err
    assert instance.active(True) == host.FALSE
    instance.start(44100.0)


def test_latency_and_tail_are_the_engines(instance):
    for rate_hz in RATES_HZ:
        instance.start(rate_hz)
        made = engine_of(PRESETS, rate_hz)
        rings = math.ceil(made.tail_seconds * rate_hz)
        assert (instance.latency(), instance.tail()) == (made.latency_samples, rings + made.latency_samples)
        instance.active(False)


def test_parameters_are_the_engines(instance):
    infos = instance.parameters()
    assert len({each.id for each in infos}) == len(infos) and max(each.id for each in infos) < 1 << 31
    names = [preset.name for preset in ABOUT.presets]
    for info, live in zip(infos, ABOUT.parameters, strict=False):
        assert (info.title, info.units) == (f"{names[live.part]}: {live.name}", live.unit)
        assert (info.unit, info.steps, info.flags) == (live.part + 1, 0, CAN_AUTOMATE)
        assert (
            instance.plain(info.id, info.default) == live.default == instance.plain(info.id, float(np.float32(info.default)))
        )
        assert (instance.plain(info.id, 0.0), instance.plain(info.id, 1.0)) == (live.minimum, live.maximum)
        assert instance.position(info.id) == info.default
        low, high = live.minimum, live.maximum
        x = 0.3
        curve = layout.PARAMETER_CURVES[live.index]
        value = (
            low * (high / low) ** x
            if curve == layout.RATIO
            else low + (high - low) * (x * x if curve == layout.SQUARE else x)
        )
        assert instance.plain(info.id, x) == pytest.approx(value, rel=1e-12)
        assert instance.normalized(info.id, value) == pytest.approx(x, rel=1e-12)
    own = len(ABOUT.parameters) + len(ABOUT.setup)
    for info, number in zip(infos[len(ABOUT.parameters) : own], ABOUT.setup, strict=True):
        assert (info.title, info.units) == (f"{names[number.part]}: {number.name}", "")
        assert (info.unit, info.steps, info.flags) == (number.part + 1, 0, READ_ONLY)
        assert instance.plain(info.id, info.default) == number.default
        text = instance.text(info.id, info.default)
        assert text.endswith(f" {number.unit} (fixed: needs Python with jawari to change; export again)")
        assert instance.parse(info.id, text) == pytest.approx(info.default, abs=1e-6)
        assert instance.turn(info.id, 0.123) != host.OK and instance.position(info.id) == info.default
    program, bypass = infos[own : own + 2]
    assert (program.flags, program.steps) == (CAN_AUTOMATE | IS_LIST | IS_PROGRAM, len(PRESETS) - 1)
    assert (bypass.flags, bypass.steps) == (CAN_AUTOMATE | IS_BYPASS, 1)
    assert [instance.text(program.id, x) for x in (0.0, 0.49, 0.51, 1.0)] == [names[0], names[0], names[1], names[1]]
    assert all(each.flags == IS_HIDDEN for each in infos[own + 2 :])


def test_texts_go_there_and_back(instance):
    for info in instance.parameters()[: len(ABOUT.parameters)]:
        for x in (0.0, 0.2, 1.0):
            text = instance.text(info.id, x)
            assert info.units not in text, "hosts put the unit behind it themselves"
            back = instance.parse(info.id, f"{text} {info.units}")
            assert back == instance.parse(info.id, text)
            assert back is not None and instance.text(info.id, back) == text
        assert instance.parse(info.id, "forty") is None


def test_controllers_are_mapped_where_the_engine_reads_them(instance):
    hidden = {each.id: each for each in instance.parameters() if each.flags & IS_HIDDEN}
    first = {6, 7, 10, 11, 38, 64, 68, 74, 98, 99, 100, 101, 120, 121, 123, 128, 129, 130}
    seen = set()
    for channel in range(16):
        mapped = {k for k in range(131) if instance.mapped(channel, k) is not None}
        assert mapped == (first if channel == 0 else {6, 7, 10, 11, 64, 74, 100, 101, 128, 129, 130})
        seen |= {instance.mapped(channel, k) for k in mapped}
    assert seen == set(hidden)
    assert instance.mapped(16, 7) is None and instance.mapped(-1, 7) is None
    for controller, rest in ((7, 100 / 127), (10, 64 / 127), (11, 1.0), (64, 0.0), (129, 8192 / 16383)):
        assert hidden[instance.mapped(0, controller)].default == rest


def test_units_and_programs_are_the_presets(instance):
    units = instance.component.query(host.UNITS)
    assert units is not None
    assert units.call(3, c.c_int32) == len(PRESETS) + 1
    room = (c.c_uint16 * 128)()
    for k, preset in enumerate(ABOUT.presets):
        said = units.call(7, c.c_int32, (c.c_int32, 1), (c.c_int32, k), (c.c_void_p, c.addressof(room)))
        assert said == host.OK and host.wide(room) == preset.name
    assert units.call(7, c.c_int32, (c.c_int32, 1), (c.c_int32, 99), (c.c_void_p, c.addressof(room))) == host.INVALID
    units.release()


def test_what_is_asked_of_nothing_is_refused(instance):
    assert instance.turn(host.NO_PARAMETER, 0.5) == host.INVALID
    assert instance.parse(host.NO_PARAMETER, "1") is None
    info = host.ParameterInfo()
    for k in (-1, 10**6):
        assert instance.controller.call(9, c.c_int32, (c.c_int32, k), (c.c_void_p, c.addressof(info))) == host.INVALID
    gain = instance.parameters()[0].id
    before = instance.position(gain)
    assert instance.turn(gain, float("nan")) == host.INVALID
    assert instance.position(gain) == before
    assert instance.processing(True) == host.NOT_INITIALIZED
    instance.process(64, expected=host.NOT_INITIALIZED)


def test_texts_of_note_expressions_are_the_same_in_every_locale(instance):
    """As those of parameters are: a point is written, a comma is read too."""
    face = instance.component.query(host.EXPRESSIONS)
    assert face is not None
    tuning, brightness = 2, 5
    room = (c.c_uint16 * 128)()

    def asked(place: int, kind: int, *more) -> int:
        return face.call(place, c.c_int32, (c.c_int32, 0), (c.c_int16, 0), (c.c_uint32, kind), *more)

    for kind, value, text in (
        (tuning, 0.5 + 3.5 / 240, "+3.5"),
        (tuning, 0.5 - 0.07 / 240, "-0.07"),
        (tuning, 0.5, "0"),
        (tuning, 1.0, "+120"),
        (brightness, 64 / 127, "64"),
    ):
        assert asked(5, kind, (c.c_double, value), (c.c_void_p, c.addressof(room))) == host.OK
        assert host.wide(room) == text
    position = c.c_double()
    for kind, text, value in (
        (tuning, "+3.5", 0.5 + 3.5 / 240),
        (tuning, " -3,5 semitones", 0.5 - 3.5 / 240),
        (tuning, "1e9", 1.0),
        (brightness, "63,5", 0.5),
    ):
        given = c.create_string_buffer(text.encode("utf-16-le") + b"\0\0")
        assert asked(6, kind, (c.c_void_p, c.addressof(given)), (c.c_void_p, c.addressof(position))) == host.OK
        assert position.value == pytest.approx(value, abs=1e-12)
    for text in ("", "nan", "inf", "high"):
        given = c.create_string_buffer(text.encode("utf-16-le") + b"\0\0")
        assert asked(6, tuning, (c.c_void_p, c.addressof(given)), (c.c_void_p, c.addressof(position))) == host.FALSE
    face.release()
