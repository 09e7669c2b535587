// A slider with its name, its value and a way back, for what has a range, a curve and a unit.

import { element } from "./elements.js";

const STEPS = 1000;
/** How a knob runs through its range (jawari.h). */
const RATIO = 1;
const SQUARE = 2;

/** @typedef {{name: string, unit: string, curve: number, minimum: number, maximum: number, initial: number}} Range */

/** The value at a place 0 … 1 of a range. @param {Range} range */
export function valueAt({ curve, minimum, maximum }, place) {
  if (curve === RATIO && minimum > 0) return minimum * (maximum / minimum) ** place;
  return minimum + (maximum - minimum) * (curve === SQUARE ? place * place : place);
}

/** The place 0 … 1 of a value. @param {Range} range */
export function placeOf({ curve, minimum, maximum }, value) {
  if (curve === RATIO && minimum > 0) return Math.log(value / minimum) / Math.log(maximum / minimum);
  const place = (value - minimum) / (maximum - minimum);
  return curve === SQUARE ? Math.sqrt(place) : place;
}

/** A number with three digits that count, or two where it has no unit. */
export function shown(value, unit) {
  const counting = unit ? 2 : 1;
  const digits = value === 0 ? 0 : Math.max(0, counting - Math.floor(Math.log10(Math.abs(value)) + 1e-9));
  const number = value.toFixed(Math.min(digits, 4)).replace("-", "−");
  return unit ? `${number} ${unit}` : number;
}

/**
 * @param {Range & {id: string}} range
 * @param {(value: number) => void} change
 */
export function slider(range, change) {
  const output = element("output");
  const input = element("input", {
    type: "range",
    min: 0,
    max: STEPS,
    step: 1,
    "aria-label": range.name,
    "data-id": range.id,
    input: () => {
      show(valueAt(range, input.value / STEPS));
      change(value);
    },
    dblclick: () => {
      back();
      change(value);
    },
  });
  let value = range.initial;
  const show = (to) => {
    value = to;
    output.textContent = shown(value, range.unit);
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const back = () => {
    input.value = String(Math.round(STEPS * placeOf(range, range.initial)));
    show(range.initial);
  };
  back();
  const name = element("span", { class: "name", text: range.name });
  return { element: element("label", { class: "slider" }, name, output, input), back, value: () => value };
}
