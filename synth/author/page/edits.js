// What an edit of one field brings with it, so that the preset stays consistent in one step of undo.

import { same, valueAt } from "./format.js";

const given = (value) => value !== null && value !== undefined && !(Array.isArray(value) && value.length === 0);

/** The changes that setting a parameter needs, itself first. `byPath`: Map of all parameters, `data`: the preset. */
export function changesFor(parameter, value, data, byPath) {
  const { path } = parameter;
  const changes = [{ path, value }];
  for (const other of parameter.instead_of ?? []) {
    if (given(value) && given(valueAt(data, other))) changes.push({ path: other, value: null });
  }
  for (const other of parameter.together_with ?? []) {
    if (given(value) === given(valueAt(data, other))) continue;
    changes.push({ path: other, value: given(value) ? (byPath.get(other)?.suggested ?? null) : null });
  }
  // a neck has as many heights as frets
  if (path === "obstacle.heights_mm" && data.obstacle.kind === "frets" && given(value) && value.length !== data.obstacle.count) {
    changes.push({ path: "obstacle.count", value: value.length });
  }
  return changes;
}

/** Lists of numbers that share their rows: the second has its column beside the first. */
export function listBeside(path) {
  if (path === "obstacle.positions_mm") return "obstacle.heights_mm";
  if (path.endsWith(".measured_frequencies_hz")) return path.replace("measured_frequencies_hz", "measured_decay_rates");
  return null;
}

/** True where another list shows this one beside its own rows. */
export function shownBeside(path, data) {
  return path.endsWith(".measured_decay_rates") || (path === "obstacle.heights_mm" && data.obstacle.kind === "points");
}

/**
 * The way back: to the saved value if it was changed since, else to the default. null where there is none, else {target,
 * toSaved, value}: where it leads, whether that is the saved value, and what an edit sends for it (null: the default).
 */
export function wayBack(parameter, value, saved) {
  const fallback = parameter.default ?? null;
  const toSaved = !same(value, saved);
  const target = toSaved ? saved : fallback;
  if (same(value, target) || (!toSaved && (parameter.required || parameter.kind === "text"))) return null;
  return { target, toSaved, value: same(target, fallback) ? null : target };
}
