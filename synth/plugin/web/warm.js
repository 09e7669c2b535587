// What is played before anybody listens: browsers compile a module's functions when they are called first, and again when they
// have been called often. It tells which keys play nothing. What was played is forgotten then.

import { BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE, PROGRAM } from "./module.js";

const LEAST_MS = 200;
const MOST_MS = 800;
const FRAMES = 128;
/** Blocks between two events, and those of which none may be late at last. */
const APART = 8;
const CALM = 64;
const FADE_BLOCKS = 8;
const SUSTAIN = 64;

/**
 * @param {import("./module.js").Module} module
 * @param {import("./drone.js").Drone | null} drone
 * @param {{presets: object[]}} described what the bank says of itself; each preset gets its `mute` keys
 */
export function warmUp(module, drone, { presets }, rate, now) {
  const left = new Float32Array(FRAMES);
  const right = new Float32Array(FRAMES);
  const play = () => module.play(left, right);
  const begun = now();
  const quantum = (1000 * FRAMES) / rate;
  presets.forEach((preset, part) => {
    preset.mute = now() - begun > MOST_MS ? [] : muteKeys(module, preset, part, play);
  });
  const steps = presets.flatMap((preset, part) => score(preset, part));
  drone?.start();
  let calm = 0;
  for (let block = 0; ; block++) {
    const at = now();
    if (at - begun > MOST_MS || (at - begun > LEAST_MS && block > steps.length * APART && calm >= CALM)) break;
    if (block % APART === 0) for (const event of steps[(block / APART) % steps.length]) module.put(0, ...event);
    drone?.play(FRAMES);
    play();
    calm = now() - at <= quantum ? calm + 1 : 0;
  }
  drone?.reset();
  module.reset();
  for (let block = 0; block < FADE_BLOCKS; block++) play();
}

/** Keys of a preset's range for which it has no string. */
function muteKeys(module, { lowest, highest }, part, play) {
  const mute = [];
  module.put(0, PROGRAM, 0, part, 0, 0);
  for (let note = lowest; note <= highest; note++) {
    const before = module.unplayed();
    module.put(0, NOTE_ON, 0, note, 60, 0);
    play();
    module.put(0, NOTE_OFF, 0, note, 64, 0);
    if (module.unplayed() > before) mute.push(note);
  }
  return mute;
}

/** Events of a preset, a list for each step: notes across its range, soft and loud, released and not, and what moves them. */
function score({ lowest, highest, mute, parameters }, part) {
  const steps = [[[PROGRAM, 0, part, 0, 0]]];
  const all = Array.from({ length: highest - lowest + 1 }, (_, k) => lowest + k).filter((note) => !mute.includes(note));
  const notes = Array.from({ length: 8 }, (_, k) => all[Math.round(((all.length - 1) * ((3 * k) % 8)) / 7)]);
  notes.forEach((note, k) => {
    steps.push([[NOTE_ON, 0, note, k % 2 ? 120 : 60, 0]]);
    const parameter = parameters[k % Math.max(parameters.length, 1)];
    if (parameter) steps.push([[PARAMETER, part, parameter.index, 0, parameter.initial]]);
    if (k % 2) steps.push([[NOTE_OFF, 0, note, 64, 0]]);
  });
  steps.push([[BEND, 0, 2000, 0, 0]], [[BEND, 0, 0, 0, 0]], [[CONTROL, 0, 1, 90, 0]], [[CONTROL, 0, 1, 0, 0]]);
  steps.push([[PRESSURE, 0, 0, 60, 0]], [[PRESSURE, 0, 0, 0, 0]], [[CONTROL, 0, SUSTAIN, 127, 0]], [[CONTROL, 0, SUSTAIN, 0, 0]]);
  steps.push(notes.map((note) => [NOTE_OFF, 0, note, 64, 0]));
  return steps;
}
