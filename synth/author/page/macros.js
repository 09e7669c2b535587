// What a player turns first: controls that stand before all others, and macros, each of which moves several values by a law.
//
//   firstOf(parameters, data)      paths of the controls that stand first, in their order
//   macrosOf(parameters, data)     macros of a preset, as parameters of makeField with `moves`, the paths that they move
//   turned(macro, data, saved)     where a macro stands: the factor from the saved values to the present ones
//   changesOf(macro, factor, data, saved, byPath)    the changes that turn it there, for one edit
//
// A macro has no value of its own in the file. Its law: value = saved value · factor^power, within what each control allows.

import { valueAt } from "./format.js";

/** Where it is plucked, how the string meets what it touches, the hand's strength and softness, the tuning. */
const FIRST = [
  "pluck.position",
  "obstacle.jiva_um",
  "obstacle.action_12th_mm",
  "setup.action_bass_mm",
  "setup.action_treble_mm",
  "obstacle.sawari_um",
  "pluck.displacement_mm",
  "pluck.width_mm",
  "damping.release_s",
  "tuning.offset_cents",
];
const LOSSES = ["viscoelastic_loss", "thermoelastic_q_inverse"];
const TURNS = 4;
const DIGITS = 6;

/** The string of a path; undefined where another document has fewer. */
const stringAt = (path, data) => data.string[Number(path.split(".")[1])];
const isLoss = (path) => /^string\.\d+\./.test(path) && LOSSES.includes(path.split(".")[2]);

const LAWS = [
  {
    path: "macro.sustain",
    label: "Sustain",
    tip: "How long the strings ring: divides the losses of all played strings by this factor.",
    power: -1,
    moves: (path, data) => isLoss(path) && stringAt(path, data)?.sympathetic === false,
  },
  {
    path: "macro.sympathetic",
    label: "Sympathetic strings",
    tip: "How long, and so how loudly, the sympathetic strings ring: divides their losses by this factor.",
    power: -1,
    moves: (path, data) => isLoss(path) && stringAt(path, data)?.sympathetic === true,
  },
  {
    path: "macro.body",
    label: "Weight of the body",
    tip: "Multiplies the masses of all the body's modes by this factor. A light body is loud and takes the strings' energy quickly.",
    power: 1,
    moves: (path) => /^body\.mode\.\d+\.mass_kg$/.test(path),
  },
];

const given = (value) => value !== null && value !== undefined;
const anchored = (value) => value !== null && typeof value === "object";
/** The numbers of a value that are more than nothing. */
const numbers = (value) => (anchored(value) ? Object.values(value) : [value]).filter((one) => typeof one === "number" && one > 0);

export function firstOf(parameters, data) {
  const known = new Map(parameters.map((one) => [one.path, one]));
  return FIRST.filter((path) => known.has(path) && (given(valueAt(data, path)) || !known.get(path).optional));
}

export function macrosOf(parameters, data) {
  return LAWS.map(({ moves, ...law }) => ({
    ...law,
    moves: parameters.map(({ path }) => path).filter((path) => moves(path, data) && numbers(valueAt(data, path)).length > 0),
    kind: "number",
    unit: "×",
    minimum: 1 / TURNS,
    maximum: TURNS,
    travel: [1 / TURNS, TURNS],
    scale: "log",
    step: 0.01,
    integer: false,
    default: 1,
    required: true,
    optional: false,
  })).filter((macro) => macro.moves.length > 0);
}

/** The saved value of a path, or the present one where it is not saved in the same form. */
function base(path, data, saved) {
  const [now, before] = [valueAt(data, path), valueAt(saved, path)];
  const alike = given(before) && anchored(now) === anchored(before) && (!anchored(now) || Object.keys(now).join() === Object.keys(before).join());
  return alike && numbers(before).length > 0 ? before : now;
}

export function turned(macro, data, saved) {
  const logs = macro.moves.flatMap((path) => {
    const before = numbers(base(path, data, saved));
    return numbers(valueAt(data, path)).map((now, i) => Math.log(now / (before[i] ?? now)));
  });
  const mean = logs.reduce((sum, one) => sum + one, 0) / logs.length;
  return Number(Math.exp(mean / macro.power).toPrecision(4));
}

export function changesOf(macro, factor, data, saved, byPath) {
  const times = factor ** macro.power;
  return macro.moves.map((path) => {
    const { minimum, maximum } = byPath.get(path) ?? {};
    const held = (value) => Math.min(maximum ?? Infinity, Math.max(minimum ?? -Infinity, value));
    const moved = (value) => (times === 1 ? value : held(Number((value * times).toPrecision(DIGITS))));
    const from = base(path, data, saved);
    return { path, value: anchored(from) ? Object.fromEntries(Object.entries(from).map(([note, value]) => [note, moved(value)])) : moved(from) };
  });
}
