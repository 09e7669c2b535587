// Names of notes, numbers for people, values by path, and small DOM helpers.

const NAMES = ["C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B"];

/** 60 → "C4". */
export function noteName(note) {
  return `${NAMES[((note % 12) + 12) % 12]}${Math.floor(note / 12) - 1}`;
}

/** "C#4", "c♯4", "60" → 60; null where it is no note. */
export function parseNote(text) {
  const match = /^\s*(?:([a-g])([#♯b♭]*)(-?\d+)|(\d+))\s*$/i.exec(text);
  if (match === null) return null;
  if (match[4] !== undefined) return Number(match[4]) <= 127 ? Number(match[4]) : null;
  const step = { c: 0, d: 2, e: 4, f: 5, g: 7, a: 9, b: 11 }[match[1].toLowerCase()];
  const shift = [...match[2]].reduce((sum, sign) => sum + (sign === "#" || sign === "♯" ? 1 : -1), 0);
  const note = step + shift + 12 * (Number(match[3]) + 1);
  return note >= 0 && note <= 127 ? note : null;
}

/** A number with as many digits as tell something: four significant ones, real minus sign. */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e-4 && size < 1e7 ? String(Number(value.toPrecision(digits))) : value.toExponential(digits - 2);
  return text.replace("e+", "e").replace(/^-/, "−");
}

/** As `number`, but what an input field takes. */
export function plain(value, digits = 6) {
  return value === null || value === undefined ? "" : String(Number(Number(value).toPrecision(digits)));
}

/** "string.0.length_m" in nested data; undefined where a part is missing. */
export function valueAt(data, path) {
  return path.split(".").reduce((place, part) => (place === null || place === undefined ? undefined : place[part]), data);
}

/** Deep equality of JSON data. */
export function same(a, b) {
  return a === b || JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
}

/** An HTML element: h("button", {type: "button", class: "icon", onclick: f, "aria-label": "Undo"}, "text", child…). */
export function h(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

/** The same in SVG. */
export function s(name, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** Colours of the theme for canvases: colour("--ink") → "rgb(…)". Draw again on store.on(["theme"]) and onScheme. */
export function colour(name) {
  const probe = h("i", { class: "hidden-text" });
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return found;
}

const dark = matchMedia("(prefers-color-scheme: dark)");

/** Called when the system changes between light and dark. */
export function onScheme(listener) {
  dark.addEventListener("change", listener);
  return () => dark.removeEventListener("change", listener);
}
