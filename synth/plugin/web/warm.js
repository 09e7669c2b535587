// What is played before anybody listens: browsers compile a module's functions when they are called first, and again when they
// have been called often. It tells which keys play nothing, and what share of its time a heavy block takes. What was played is
// forgotten then.

import { BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE, PROGRAM } from "./events.js";

/** Computing [ms], behind which no more is begun: of what is not always played, and of the parts' chords. A block for each key, a
 * stroke of each kind and the first part's chord are played however long they take. */
const MORE_MS = 350;
const CHORDS_MS = 350;
const FRAMES = 128;
/** Blocks between two events, and those of a chord. */
const APART = 3;
const CHORD = 48;
const CHORD_NOTES = 12;
const FADE_BLOCKS = 8;
const SOFT = 40;
const LOUD = 127;
/** Keys below the range among which those lie that choose an articulation. */
const SWITCHES = 24;
const [WHEEL, SUSTAIN, SOSTENUTO, LEGATO] = [1, 64, 66, 68];

/**
 * In slices: it yields behind each block. Its value is the share of a block's time that the heaviest of the parts' chords took.
 * Again: the module was warmed in another context of this page before, and browsers keep what they have compiled of it, so
 * that the keys and the strokes of each kind are enough; the value is 0 then.
 *
 * @param {import("./module.js").Module} module
 * @param {import("./drone.js").Drone | null} drone
 * @param {{presets: object[]}} described what the bank says of itself; each preset gets its `mute` keys
 */
export function* warmUp(module, drone, { presets }, rate, now, again = false) {
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
  /** The scores of the parts side by side. */
  function* playAll(scores, goesOn) {
    for (let step = 0; scores.some((steps) => step < steps.length); step++)
      for (const [part, steps] of scores.entries()) {
        if (step >= steps.length || !goesOn()) continue;
        module.put(0, PROGRAM, 0, part, 0, 0);
        for (const event of steps[step]) module.put(0, ...event);
        yield* play(APART);
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
  module.reset();
  drone?.hurry();
  yield* playAll(found.map(once), () => true);
  if (again) {
    drone?.reset();
    module.reset();
    yield* play(FADE_BLOCKS);
    return 0;
  }
  const most = spent + MORE_MS;
  yield* playAll(found.map(more), () => spent < most);
  drone?.reset();
  let load = 0;
  const until = spent + CHORDS_MS;
  for (const { part, played } of found) {
    if (part > 0 && spent > until) break;
    module.reset();
    yield* play(FADE_BLOCKS);
    const before = spent;
    module.put(0, PROGRAM, 0, part, 0, 0);
    module.put(0, CONTROL, 0, SUSTAIN, 127, 0);
    for (const note of new Set(across(played, CHORD_NOTES))) module.put(0, NOTE_ON, 0, note, LOUD, 0);
    yield* play(CHORD);
    load = Math.max(load, (spent - before) / ((CHORD * 1000 * FRAMES) / rate));
  }
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

const on = (note, velocity) => [NOTE_ON, 0, note, velocity, 0];
const off = (note) => [NOTE_OFF, 0, note, 64, 0];
const press = (note) => [on(note, 100), off(note)];
const control = (number, value) => [CONTROL, 0, number, value, 0];
const strokes = (notes) => notes.flatMap((note, k) => [[on(note, SOFT)], [on(note, LOUD)], k % 2 ? [off(note)] : []]);

/** Events, a list for each step, that are always played: a few notes, soft and loud, released and not, those with each pedal and
 * each articulation, and what moves them. */
function once({ played, switches }) {
  const notes = across(played, 3);
  const steps = strokes(notes);
  for (const number of [SUSTAIN, SOSTENUTO, LEGATO])
    steps.push([...notes.map((note) => on(note, LOUD)), control(number, 127)], notes.map(off), [control(number, 0)]);
  for (const key of switches) steps.push([...press(key), on(notes[0], SOFT), on(notes[1], LOUD)], notes.map(off));
  steps.push(switches.slice(0, 1).flatMap(press));
  steps.push([[BEND, 0, 4000, 0, 0]], [[BEND, 0, 0, 0, 0], control(WHEEL, 90)], [control(WHEEL, 0), [PRESSURE, 0, 0, 60, 0]]);
  steps.push([[PRESSURE, 0, 0, 0, 0], ...notes.map(off)]);
  return steps;
}

/** Those that are played while there is time: notes across the range, pedals under a chord, every parameter. */
function more({ part, played, parameters }) {
  const notes = across(played, 8);
  const held = notes.slice(0, 6);
  const steps = strokes(notes);
  for (const number of [SUSTAIN, SOSTENUTO, LEGATO])
    steps.push(held.map((note) => on(note, LOUD)), [control(number, 127)], held.map(off), [control(number, 0)]);
  for (const { index, initial, minimum, maximum } of parameters) {
    const aside = initial + 0.05 * ((minimum + maximum) / 2 - initial);
    steps.push([on(notes[2], 100), [PARAMETER, part, index, 0, aside]], [[PARAMETER, part, index, 0, initial]]);
  }
  steps.push(notes.map(off));
  return steps;
}
