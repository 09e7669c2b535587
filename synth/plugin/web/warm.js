// What is played before anybody listens: browsers compile a module's functions when they are called first, and again when they
// have been called often. It tells which keys play nothing, and what share of its time a heavy block takes. What was played is
// forgotten then.

import { BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE, PROGRAM } from "./module.js";

/** Computing at most, without the last chord [ms]. */
const MOST_MS = 350;
const FRAMES = 128;
/** Blocks between two events, and those of the last chord. */
const APART = 3;
const CHORD = 48;
const FADE_BLOCKS = 8;
const SOFT = 40;
const LOUD = 127;
/** Keys below the range among which those lie that choose an articulation. */
const SWITCHES = 24;
const [WHEEL, SUSTAIN, SOSTENUTO, LEGATO] = [1, 64, 66, 68];

/**
 * In slices: it yields behind each block. Its value is the share of a block's time that the last chord took.
 *
 * @param {import("./module.js").Module} module
 * @param {import("./drone.js").Drone | null} drone
 * @param {{presets: object[]}} described what the bank says of itself; each preset gets its `mute` keys
 */
export function* warmUp(module, drone, { presets }, rate, now) {
  const left = new Float32Array(FRAMES);
  const right = new Float32Array(FRAMES);
  let spent = 0;
  function* play(blocks) {
    for (let block = 0; block < blocks; block++) {
      const at = now();
      drone?.play(FRAMES);
      module.play(left, right);
      spent += now() - at;
      yield;
    }
  }
  const found = [];
  for (const [part, preset] of presets.entries()) {
    module.put(0, PROGRAM, 0, part, 0, 0);
    const { lowest, highest } = preset;
    const played = yield* keysThatPlay(module, lowest, highest, play);
    preset.mute = keys(lowest, highest).filter((note) => !played.includes(note));
    const switches = yield* keysThatPlay(module, Math.max(lowest - SWITCHES, 0), lowest - 1, play);
    found.push({ part, played, switches, parameters: preset.parameters });
  }
  const scores = found.map(score);
  drone?.hurry();
  for (let step = 0; scores.some((steps) => step < steps.length); step++)
    for (const steps of scores) {
      if (step >= steps.length || spent > MOST_MS) continue;
      for (const event of steps[step]) module.put(0, ...event);
      yield* play(APART);
    }
  drone?.reset();
  const before = spent;
  const { played } = found[0];
  module.put(0, PROGRAM, 0, 0, 0, 0);
  module.put(0, CONTROL, 0, SUSTAIN, 127, 0);
  for (const note of across(played, 6)) module.put(0, NOTE_ON, 0, note, LOUD, 0);
  yield* play(CHORD);
  const load = (spent - before) / ((CHORD * 1000 * FRAMES) / rate);
  module.reset();
  yield* play(FADE_BLOCKS);
  return load;
}

const keys = (lowest, highest) => Array.from({ length: highest - lowest + 1 }, (_, k) => lowest + k);

/** So many of a list's entries, from end to end. */
const across = (list, count) => Array.from({ length: count }, (_, k) => list[Math.round(((list.length - 1) * k) / (count - 1))]);

/** Those of a range that do something: play a string, or choose an articulation. */
function* keysThatPlay(module, lowest, highest, play) {
  const found = [];
  for (const note of keys(lowest, highest)) {
    const before = module.unplayed();
    module.put(0, NOTE_ON, 0, note, 60, 0);
    yield* play(1);
    module.put(0, NOTE_OFF, 0, note, 64, 0);
    if (module.unplayed() === before) found.push(note);
  }
  return found;
}

/** Events, a list for each step: soft and loud notes across the range with each articulation, released and not, and what moves
 * them. */
function score({ part, played, switches, parameters }) {
  const on = (note, velocity) => [NOTE_ON, 0, note, velocity, 0];
  const off = (note) => [NOTE_OFF, 0, note, 64, 0];
  const press = (note) => [on(note, 100), off(note)];
  const notes = across(played, 8);
  const held = notes.slice(0, 6);
  const pedal = (number) => [[[CONTROL, 0, number, 127, 0]], held.map(off), [[CONTROL, 0, number, 0, 0]]];
  const steps = [[[PROGRAM, 0, part, 0, 0]]];
  for (const [k, note] of notes.entries()) steps.push([on(note, SOFT)], [on(note, LOUD)], k % 2 ? [off(note)] : []);
  steps.push([[BEND, 0, 4000, 0, 0]], [[BEND, 0, -4000, 0, 0]], [[BEND, 0, 0, 0, 0]]);
  steps.push([[CONTROL, 0, WHEEL, 90, 0]], [[CONTROL, 0, WHEEL, 0, 0]], [[PRESSURE, 0, 0, 60, 0]], [[PRESSURE, 0, 0, 0, 0]]);
  for (const number of [SUSTAIN, SOSTENUTO, LEGATO]) steps.push(held.map((note) => on(note, LOUD)), ...pedal(number));
  for (const key of switches) steps.push(press(key), [on(notes[1], SOFT), on(notes[5], LOUD)], [off(notes[1]), off(notes[5])]);
  steps.push(switches.slice(0, 1).flatMap(press));
  for (const { index, initial, minimum, maximum } of parameters) {
    const aside = initial + 0.05 * ((minimum + maximum) / 2 - initial);
    steps.push([on(notes[2], 100), [PARAMETER, part, index, 0, aside]], [[PARAMETER, part, index, 0, initial]]);
  }
  steps.push(notes.map(off));
  return steps;
}
