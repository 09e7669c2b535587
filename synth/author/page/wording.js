// Paths of a preset in the words of its controls, for reasons of refusals and names of steps:
//
//   labelOf("string.0.length_m", parameters, data)      // "Pa string, Length"
//   inWords("give either distance_mm or …", parameters)  // "give either “Thread to edge” or …"
//
// parameters: as GET …/parameters lists them; data: the preset.

import { noteName, valueAt } from "./format.js";

/** What people call a row of [[string]]: its name, else its notes, else its number. */
export function stringName(row, index) {
  const [low, high] = Array.isArray(row?.notes) ? row.notes : [];
  const range = low === undefined ? "" : low === high ? noteName(low) : `${noteName(low)}–${noteName(high)}`;
  return row?.name || range || String(index + 1);
}

/** The table that a path lies in, where there are several of its kind: "Pa string", "Resonance 2". */
function rowOf(path, data) {
  const [table, index] = path.split(".");
  if (index === undefined || !/^\d+$/.test(index)) return "";
  if (table === "string") return `${stringName(valueAt(data, `string.${index}`), Number(index))} string`;
  return table === "nut" ? `Resonance ${Number(index) + 1}` : "";
}

export function labelOf(path, parameters, data) {
  const row = rowOf(path, data);
  const named = parameters
    .filter((one) => path === one.path || path.startsWith(`${one.path}.`))
    .reduce((best, one) => (one.path.length > (best?.path.length ?? 0) ? one : best), null);
  const rest = named ? path.slice(named.path.length + 1) : "";
  if (named === null || (named.item === "table" && row !== "")) {
    const key = path.split(".").at(-1);
    return row === "" ? path : path.split(".").length > 2 ? `${row}, ${key}` : row;
  }
  const part = rest === "" ? "" : /^\d+$/.test(rest) && named.kind === "list" ? ` ${Number(rest) + 1}` : ` at ${noteAt(rest)}`;
  return `${row === "" ? "" : `${row}, `}${named.label}${part}`;
}

const noteAt = (text) => (/^\d+$/.test(text) ? noteName(Number(text)) : text);

/** A message with the keys of the file in it, in the controls' words. */
export function inWords(message, parameters) {
  return message.replace(/\b(?:[a-z]+\.)?([a-z0-9]+(?:_[a-z0-9]+)+)\b/g, (whole, key) => {
    const found = parameters.find((one) => one.path === whole) ?? parameters.find((one) => one.path.split(".").at(-1) === key);
    return found ? `“${found.label}”` : whole;
  });
}

/** The name of a step of undo, which the server gives as the paths that it changed. */
export function stepName(label, parameters, data) {
  const all = [...new Set(label.split(", ").map((path) => labelOf(path, parameters, data)))];
  return all.length > 2 ? `${all[0]} and ${all.length - 1} more` : all.join(" and ");
}
