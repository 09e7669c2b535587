// What is typed into the field of a number, with its unit or without: "0.02 mm", "20um", "42 %", "1.2 kHz", in the unit of
// the field.

import { parseNumber } from "./scale.js";

/** What there is to measure, and how much of the first of its units each of them is. */
const MEASURES = [
  ["a length", { m: 1, cm: 1e-2, mm: 1e-3, µm: 1e-6, nm: 1e-9 }],
  ["a time", { s: 1, ms: 1e-3, µs: 1e-6, min: 60 }],
  ["a frequency", { Hz: 1, kHz: 1e3 }],
  ["an interval", { cents: 1, cent: 1, semitones: 100, semitone: 100 }],
  ["a level", { dB: 1 }],
  ["a mass", { kg: 1, g: 1e-3, mg: 1e-6 }],
  ["a mass per length", { "kg/m": 1, "g/m": 1e-3, "g/cm": 1e-1, "mg/mm": 1e-3 }],
  ["a density", { "kg/m³": 1, "g/cm³": 1e3 }],
  ["an elastic modulus", { Pa: 1, kPa: 1e3, MPa: 1e6, GPa: 1e9 }],
  ["a stiffness", { "N/m": 1, "N/mm": 1e3, "N/µm": 1e6 }],
  ["a rate of decay", { "1/s": 1, "1/ms": 1e3 }],
  ["a share of the length", { "of L": 1, L: 1, "%": 1e-2 }],
  ["a multiple of the string's impedance", { "× Z": 1, Z: 1 }],
];

/** One spelling of a unit: "um" and "μm" (the Greek letter) are "µm" (the micro sign), "kg/m^3" is "kg/m³". */
function spelt(text) {
  return text
    .replace(/\s+/g, "")
    .replace(/μ|^u(?=[ms])|(?<=\/)u(?=m)/g, "µ")
    .replace(/\^?3$/, "³")
    .replace(/^[x*](?=z)/i, "×")
    .replace(/^(s\^?[-−]1|s⁻¹)$/, "1/s");
}

/** Of the units that the measure has, the one that is spelt so; "GPA" is taken for GPa. */
function named(units, text) {
  const wanted = spelt(text);
  const names = Object.keys(units);
  return names.find((name) => spelt(name) === wanted) ?? names.find((name) => spelt(name).toLowerCase() === wanted.toLowerCase());
}

/** {value}, in the field's unit ("" for a bare number), or {reason}: why the text is none. */
export function parseQuantity(text, unit = "") {
  // a number, then whatever is no number any more
  const [, digits, rest] = /^\s*([-+−]?[\d.,]*(?:[eE][-+−]?\d+)?)\s*(.*?)\s*$/.exec(text);
  const number = parseNumber(digits);
  if (Number.isNaN(number)) return { reason: `must be a number, got “${text.trim()}”` };
  if (rest === "") return { value: number };
  const measure = MEASURES.find(([, units]) => unit in units);
  if (measure === undefined) {
    return { reason: unit === "" ? `must be a number without a unit, got “${text.trim()}”` : `must be in ${unit}, got “${text.trim()}”` };
  }
  const [what, units] = measure;
  const given = named(units, rest);
  if (given === undefined) {
    const others = Object.keys(units).filter((name) => name !== unit);
    const also = others.length > 0 ? ` (or ${others.join(", ")})` : "";
    return { reason: `must be ${what} in ${unit}${also}, got “${text.trim()}”` };
  }
  return { value: Number(((number * units[given]) / units[unit]).toPrecision(12)) };
}
