"""The drone of a page: `web/drone.js` plays the strokes that the score of a bank says, as Python works them out."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from synth.drone import cycle as playing
from synth.instrument.preset import load_preset
from synth.plugin import bankfile, webfolder
from synth.plugin.droning import CHANNEL, DroneSettings

RATE_HZ = 48000
NOTE_ON, NOTE_OFF, PARAMETER, TUNING = 1, 2, 6, 9
#: the processor of the audio thread in Node: its drone plays by itself, and says what events it puts
PROGRAM = """
import fs from "node:fs";
globalThis.sampleRate = 48000;
let told, Processor;
globalThis.AudioWorkletProcessor = class { port = { postMessage: (message) => (told = message) }; };
globalThis.registerProcessor = (name, given) => (Processor = given);
const [program, wasm, bank, script] = process.argv.slice(2);
await import(program);
const bytes = (file) => new Uint8Array(fs.readFileSync(file)).buffer;
const it = new Processor({ processorOptions: { wasm: bytes(wasm), bank: bytes(bank), measure: false } });
it.port.onmessage({ data: { kind: 1, channel: 0, a: 48, b: 100, value: 0 } }); // too early: nothing is heard of it
while (told.warming) it.port.onmessage({ data: { warm: true } });
if (told.failed) throw new Error(told.failed);
if (it.module.voices() || it.module.notes() || it.drone.waits()) throw new Error("the warm-up has left something");
const begun = it.drone.now;
const events = [];
it.module.put = (frame, ...event) => events.push([it.drone.now - begun + frame, ...event]);
for (const [message, seconds] of JSON.parse(script)) {
  it.hear(message);
  const until = it.drone.now + seconds * sampleRate;
  while (it.drone.now < until) it.drone.play(128);
}
console.log(JSON.stringify(events));
"""


@pytest.fixture(scope="module")
def drone():
    return DroneSettings(sa_hz=130.8).on(load_preset("tanpura-light"))


@pytest.fixture(scope="module")
def played(drone, web_library: Path, tmp_path_factory):
    """played([(message to the audio thread, seconds after it), …]) -> its events: frame, kind, channel, a, b, value."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    folder = tmp_path_factory.mktemp("drone")
    (folder / "worklet.mjs").write_text(webfolder.program("worklet.js"))
    (folder / "run.mjs").write_text(PROGRAM)
    data = bankfile.bank([drone.strings.preset], [float(RATE_HZ)], name="drone", drone=drone, quality="draft")
    (folder / "it.jawari").write_bytes(data)

    def play(script: list) -> list[list]:
        arguments = [str(folder / "worklet.mjs"), str(web_library), str(folder / "it.jawari"), json.dumps(script)]
        done = subprocess.run(["node", str(folder / "run.mjs"), *arguments], capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    return play


def variations(drone, count: int) -> list[tuple[float, ...]]:
    places, least = playing.places(drone.gaps), min(drone.gaps)
    strings = len(places)
    return [tuple(drone.cycle.variation(n, n // strings + places[n % strings], least)) for n in range(count)]


def test_strokes_come_where_the_score_has_them(drone, played) -> None:
    events = played([({"drone": "start"}, 30)])
    strokes = [each for each in events if each[1] == NOTE_ON]
    places, keys = playing.places(drone.gaps), drone.strings.keys
    strings, cycle_s = len(keys), drone.cycle.cycle_s
    varied = variations(drone, len(strokes))
    assert len(strokes) > 15
    assert [each[3] for each in strokes] == [keys[n % strings] for n in range(len(strokes))]
    assert {each[2] for each in strokes} == {CHANNEL}
    due = [playing.LEAD_S + (n // strings + places[n % strings] + varied[n][0]) * cycle_s for n in range(len(strokes))]
    np.testing.assert_allclose([each[0] for each in strokes], np.array(due) * RATE_HZ, atol=1)
    loud = [min(max(round(drone.cycle.velocity * each[2]), 1), 127) for each in varied]
    np.testing.assert_allclose([each[4] for each in strokes], loud, atol=1)


def test_each_stroke_has_its_finger_and_ends_the_one_before(drone, played) -> None:
    events = played([({"drone": "start"}, 12)])
    width = drone.strings.preset.pluck.width_mm
    position = drone.strings.preset.pluck.position
    at = [n for n, each in enumerate(events) if each[1] == NOTE_ON]
    for number, (n, varied) in enumerate(zip(at, variations(drone, len(at)), strict=True)):
        *before, there, back_position, back_width = events[max(n - 3, 0) : n + 3]
        assert [each[1] for each in before[-2:]] == [PARAMETER, PARAMETER]
        assert before[-2][5] == pytest.approx(position + varied[3]) and before[-1][5] == pytest.approx(width * varied[4])
        assert (back_position[5], back_width[5]) == (position, width)
        if number:
            assert events[n - 3][1] == NOTE_OFF and events[n - 3][3] == events[at[number - 1]][3]
        assert there[0] == before[-1][0]


def test_another_pace_holds_from_the_next_stroke_on(drone, played) -> None:
    slow = played([({"drone": "start"}, 10), ({"drone": "seconds", "value": 5.5}, 20)])
    fast = played([({"drone": "start"}, 10), ({"drone": "seconds", "value": 2.75}, 20)])
    frames = [[each[0] for each in events if each[1] == NOTE_ON] for events in (slow, fast)]
    early = [[frame for frame in each if frame < 10 * RATE_HZ] for each in frames]
    assert early[0] == early[1]
    first = len(early[0])
    assert abs(frames[0][first] - frames[1][first]) < 0.2 * RATE_HZ  # but for how the hand strays
    strings = len(drone.strings.keys)
    cycles = [(each[first + strings] - each[first]) / RATE_HZ for each in frames]
    assert cycles[1] == pytest.approx(cycles[0] / 2, rel=0.1)


def test_it_ends_with_the_string_let_go(drone, played) -> None:
    events = played([({"drone": "start"}, 10), ({"drone": "stop"}, 10)])
    assert events[-1][0] == 10 * RATE_HZ and events[-1][1] == NOTE_OFF
    assert played([({"drone": "start"}, 10), ({"reset": True}, 10)])[-1][0] < 10 * RATE_HZ


def test_the_tonic_is_there_at_once_before_the_first_stroke_and_turned_by_pegs_later(drone, played) -> None:
    pitches = dict(drone.steps)
    keys = list(drone.strings.keys)
    at_once = [each for each in played([({"drone": "tonic", "value": 2}, 1)]) if each[1] == TUNING]
    assert [(each[3], each[4]) for each in at_once] == [(key, 1) for key in keys]
    assert [each[5] for each in at_once] == pytest.approx(pitches[2.0])
    script = [({"drone": "start"}, 8), ({"drone": "tonic", "value": 1}, 4)]
    turned = [each for each in played(script) if each[1] == TUNING]
    steps = [each for each in turned if each[3] == keys[0]]
    whole = round(playing.SEMITONE_S / playing.STEP_S)
    assert len(steps) in (whole, whole + 1)  # what rounding has left over takes a step of its own
    assert steps[-1][5] == pytest.approx(pitches[1.0][0])
    assert (steps[-1][0] - steps[0][0]) / RATE_HZ == pytest.approx(playing.SEMITONE_S, abs=1.5 * playing.STEP_S)
