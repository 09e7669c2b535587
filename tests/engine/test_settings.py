"""The settings of an engine are said once: engines, render jobs, sessions and the command line have the same."""

from __future__ import annotations

import argparse
import pickle
from dataclasses import FrozenInstanceError, fields, replace
from typing import get_type_hints

import numpy as np
import pytest

from synth.cli import common
from synth.engine.engine import Engine
from synth.engine.engine_settings import DEFAULTS, SETTINGS, EngineOptions, EngineSettings
from synth.host.render import RenderSettings
from synth.instrument.preset import load_preset
from synth.live.session import SessionSettings

#: of each setting a value that it can have, and one that it cannot, with what is said of that
VALUES = {
    "quality": ("draft", "best", "quality must be one of draft, standard, fine, reference, got 'best'"),
    "scheme": ("moreau-jean", "none", "unknown contact scheme 'none'"),
    "restitution": (0.5, 2.0, "restitution must lie between 0 and 1, got 2"),
    "internal_rate_hz": (88200.0, -1.0, "internal_rate_hz must lie between 0 and 4.9152e+07 Hz, got -1"),
    "precision": ("float64", "half", "precision must be one of float64, float32, or None for the planned one, got 'half'"),
    "economy": (False, "yes", "economy must be True or False, got 'yes'"),
    "limiter": (False, None, "limiter must be True or False, got None"),
    "gain_db": (-6.0, 201.0, "gain_db must lie between -200 and 200 dB, got 201"),
    "polyphony": (3, 0, "polyphony must be at least 1, got 0"),
    "threads": (2, 0, "threads must be a whole number from 1 on or 'auto', got 0"),
    "mpe": (True, "zone", "mpe must be True or False, got 'zone'"),
    "seed": (7, 1 << 31, "seed must be at most 2147483647, got 2147483648"),
}


def test_a_setting_has_one_name_and_type_everywhere() -> None:
    assert get_type_hints(EngineOptions) == get_type_hints(EngineSettings)
    assert list(VALUES) == list(SETTINGS) == list(DEFAULTS) == [each.name for each in fields(EngineSettings)]
    for name in SETTINGS:
        assert {name} <= {each.name for each in fields(RenderSettings)} & {each.name for each in fields(SessionSettings)}
    assert RenderSettings("a.mid", None).of_engine() == EngineSettings(threads="auto")
    assert SessionSettings().of_engine() == EngineSettings()


@pytest.mark.parametrize("name", VALUES)
def test_a_value_that_cannot_be_is_refused_wherever_it_is_given(name: str) -> None:
    good, bad, said = VALUES[name]
    assert getattr(EngineSettings(**{name: good}), name) == good
    job, session = RenderSettings("a.mid", None, **{name: good}), SessionSettings(**{name: good})
    assert getattr(job.of_engine(), name) == getattr(session.of_engine(), name) == good
    makers = (
        lambda: EngineSettings(**{name: bad}),
        lambda: replace(EngineSettings(), **{name: bad}),
        lambda: RenderSettings("a.mid", None, **{name: bad}),
        lambda: SessionSettings(**{name: bad}),
        lambda: Engine([load_preset("tanpura-light")], **{name: bad}),
    )
    for make in makers:
        with pytest.raises((ValueError, TypeError)) as caught:
            make()
        assert str(caught.value).startswith(said)


def test_what_is_no_record_of_settings_and_two_names_of_one_are_refused() -> None:
    parts = [load_preset("tanpura-light")]
    with pytest.raises(TypeError, match=r"settings must be an EngineSettings, got \{'quality': 'fine'\}"):
        Engine(parts, settings={"quality": "fine"})
    with pytest.raises(TypeError, match="polyphony and max_polyphony must not both be given"):
        Engine(parts, polyphony=8, max_polyphony=2)
    assert Engine(parts, max_polyphony=2).settings.polyphony == 2


@pytest.mark.parametrize("name", ["limiter", "quality", "threads"])
def test_an_array_is_refused_by_name(name: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f"^{name} must be "):
        EngineSettings(**{name: np.array([1, 1])})


def test_settings_are_constant_and_numbers_of_one_kind() -> None:
    settings = EngineSettings(gain_db=-6, internal_rate_hz=88200)
    assert (type(settings.gain_db), type(settings.internal_rate_hz)) == (float, float)
    with pytest.raises(FrozenInstanceError):
        settings.gain_db = 0.0  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(settings)) == settings


def test_modes_are_economised_as_planned_unless_told_otherwise() -> None:
    found = {quality: EngineSettings(quality=quality).economises for quality in ("draft", "standard", "fine", "reference")}
    assert found == {"draft": True, "standard": True, "fine": False, "reference": False}
    assert EngineSettings(quality="fine", economy=True).economises
    assert not EngineSettings(economy=False).economises


def test_an_engine_takes_settings_together_and_by_name() -> None:
    parts = [load_preset("tanpura-light")]
    settings = EngineSettings(quality="fine", gain_db=-3.0)
    assert Engine(parts, settings=settings).settings is not settings
    assert Engine(parts, settings=settings).settings == Engine(parts, quality="fine", gain_db=-3.0).settings == settings
    assert Engine(parts, settings=settings, gain_db=1.0).settings == replace(settings, gain_db=1.0)
    assert Engine(parts, max_polyphony=2).settings == EngineSettings(polyphony=2)
    job = RenderSettings("a.mid", None, quality="draft")
    assert Engine(parts, settings=job).settings == EngineSettings(quality="draft", threads="auto")


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    common.add_physics(parser)
    common.add_instruments(parser)
    common.add_controllers(parser)
    common.add_threads(parser)
    common.add_seed(parser)
    common.add_setting(parser, "--gain", "gain_db")
    return parser.parse_args(words)


def test_a_command_line_gives_the_settings_that_were_typed() -> None:
    assert EngineSettings(**common.engine_options(parsed())) == EngineSettings(threads="auto")
    words = "--quality fine --internal-rate 88200 --polyphony 4 --threads 2 --mpe --seed 5 --gain=-6 --precision float64"
    assert EngineSettings(**common.engine_options(parsed(*words.split()))) == EngineSettings(
        quality="fine", internal_rate_hz=88200.0, polyphony=4, threads=2, mpe=True, seed=5, gain_db=-6.0, precision="float64"
    )
    with pytest.raises(argparse.ArgumentError, match="must be a number from -96 to 96 dB, got '100'"):
        parsed("--gain", "100")
    with pytest.raises(argparse.ArgumentError, match="invalid choice: 'best'"):
        parsed("--quality", "best")


def test_what_a_command_takes_can_be_set() -> None:
    for name, each in SETTINGS.items():
        for value in each.typed or ():
            assert each.checked(name, value) == value
