"""The option --cc."""

from __future__ import annotations

import pytest

from synth.host.bindings import check_parts, parse_bindings
from synth.instrument.preset import load_preset


def test_bindings_are_read():
    assert parse_bindings([]) == {}
    assert parse_bindings(
        ["74=pluck.position", " 1 = obstacle.height : -50 : 20 ,2=output.gain", "74=pluck.width:50:0.5"]
    ) == {
        74: [(None, "pluck.position", None, None), (None, "pluck.width", 50.0, 0.5)],
        1: [(None, "obstacle.height", -50.0, 20.0)],
        2: [(None, "output.gain", None, None)],
    }


@pytest.mark.parametrize(
    "text, problem",
    [
        ("", "is not CONTROLLER=PARAMETER"),
        ("74", "--cc '74' is not CONTROLLER=PARAMETER"),
        ("74=", "is not CONTROLLER=PARAMETER"),
        ("a=output.gain", "is not CONTROLLER=PARAMETER"),
        ("-1=output.gain", "is not CONTROLLER=PARAMETER"),
        ("74=output.gain:1", "is not CONTROLLER=PARAMETER"),
        ("74=output.gain:1:2:3", "is not CONTROLLER=PARAMETER"),
        ("74=loudness", "--cc '74=loudness': no live parameter 'loudness'; there are output.gain, pluck.position"),
        ("64=output.gain", "--cc '64=output.gain': controller 64 cannot be bound: 0, 6, 32"),
        ("128=output.gain", "a controller must lie between 0 and 127, got 128"),
        ("74=output.gain:low:high", "low:high must be two numbers"),
        ("74=output.gain:0:5", "output.gain must lie between 0 and 4, got 5"),
        ("74=output.gain:0:nan", "output.gain must lie between 0 and 4, got nan"),
    ],
)
def test_what_is_refused_and_why(text, problem):
    with pytest.raises(ValueError, match="--cc") as raised:
        parse_bindings(["2=output.gain", text])
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_parameter_that_no_part_has():
    bindings = parse_bindings(["1=obstacle.height"])
    check_parts(bindings, [load_preset("fretted-bass"), load_preset("tanpura-light")])
    with pytest.raises(
        ValueError, match=r"--cc: controller 1 is bound to obstacle.height, which no part has \(fretted-bass\)"
    ):
        check_parts(bindings, [load_preset("fretted-bass")])
