// The picture of a buzz map: the neck from above, strings as rows with the lowest at the bottom, frets narrowing as on a neck;
// strings without frets side by side, in the order of the file. Each note is coloured by how hard it may be plucked before it buzzes, and says on what.
//
//   const map = makeNeckMap({ told(note), hear(note, {threshold}) });   // the note that is looked at; Enter, click; with Shift
//   map.show(notes, dark);           // rows of the server's map, or null; dark: the paper
//   map.element

import { differenceRamp, sample, toOklab } from "./colour.js";
import { h, noteName, number, s } from "./format.js";
import { grid } from "./roving.js";

/** A letter of a string's name and what its margins take, the open string and the space behind it, a row, frets' numbers [px]. */
const [LETTER, MARGINS] = [7.2, 18];
const OPEN = 38;
const NUT = 7;
const ROW = 38;
const FOOT = 20;
/** The narrowest that a fret may be drawn, and how wide a string without frets is, at least and at most [px]. */
const NARROWEST = 17;
const [LEAST_OPEN, MOST_OPEN] = [42, 96];
/** Where a colour stands in lightness between those that dark and light letters are read on. */
const HALF_LIGHT = 0.57;

/** Colours go from half of the stroke to twice the stroke. */
export const SHARES = [0.5, 0.7, 1, 1.4, 2];

/** CSS colour of a threshold over the stroke, and whether letters on it are to be light. */
export function shade(share, dark) {
  const found = sample(differenceRamp(dark), 0.5 - 0.5 * Math.log2(Math.min(2, Math.max(0.5, share))));
  const [lightness] = toOklab(/(\d+) (\d+) (\d+)/.exec(found).slice(1).map((c) => c / 255));
  return { fill: found, light: lightness < HALF_LIGHT };
}

const resting = (note) => note.rests;
const silent = (note) => note.buzz_mm === null;
const stringOf = ({ table, opened }) => `${table} ${opened}`;

/** What a note buzzes on, in the few letters that a cell has room for: "7", "b3", "310". */
const short = (name) => name.replace(/^(fret|board at) /, "").replace(/ mm$/, "").replace(/^(bridge)? ?point /, (_, bridge) => (bridge ? "b" : "p"));

/** The same in a sentence. */
const named = (name) => (/^(bridge$|board|sawari)/.test(name) ? `the ${name}` : name);

/** Marks of a note, as the terminal has them: it buzzes at the stroke, may, comes and goes; it rests. */
const marks = (note) =>
  resting(note) ? "×" : `${note.uncertain ? "?" : note.buzzes ? "*" : ""}${note.chaotic_up_to_mm !== null ? "~" : ""}`;

/** The velocity that plays a note's threshold, as far as a key gives it. */
export const thresholdVelocity = (note) =>
  note.buzz_velocity === null ? null : Math.max(1, Math.min(127, Math.round(note.buzz_velocity)));

export const where = (note) => `${note.string} string, ${note.fret === 0 ? "open" : `fret ${note.fret}`}, ${noteName(note.key)}`;

/** Millimetres as a feeler gauge has them; less than a tenth with as many digits as tell something. */
const figures = (mm) => (mm < 0.1 ? number(mm, 2) : mm.toFixed(2));

/** What the map says of a note. */
export function inWords(note) {
  const mm = (value) => `${figures(value)} mm`;
  if (resting(note)) return `rests on ${named(note.touches)} before it is plucked: lower that or raise the string`;
  const touches = note.touch_mm === null ? null : `touches ${named(note.touches)} from ${mm(note.touch_mm)} on`;
  if (silent(note)) return `${touches ? `${touches}, but ` : ""}no buzz up to ${mm(note.limit_mm)}`;
  const between = `${mm(note.buzz_mm)} on (${figures(note.buzz_low_mm)} to ${note.buzz_high_mm === null ? "more" : figures(note.buzz_high_mm)})`;
  const velocity = note.buzz_velocity === null ? "" : note.buzz_velocity > 127 ? ", harder than any key" : `, about velocity ${Math.round(note.buzz_velocity)}`;
  const now = note.uncertain ? "may or may not buzz" : note.buzzes ? "buzzes" : "does not buzz";
  return [
    ...(touches ? [touches] : []),
    `buzzes on ${named(note.buzzes_on)} from ${between}${velocity}`,
    ...(note.chaotic_up_to_mm === null ? [] : [`chaotic: up to ${mm(note.chaotic_up_to_mm)} the buzz comes and goes`]),
    `at this stroke, ${mm(note.stroke_mm)}, it ${now}`,
  ].join("; ");
}

export function makeNeckMap({ told, hear }) {
  const svg = s("svg", { class: "neck-map", role: "grid", "aria-label": "Buzz map of the neck" });
  let shown = null;
  let dark = false;
  let width = 0;
  let looked = null;

  const noteAt = (target) => {
    const cell = target.closest?.("[data-note]");
    return cell ? shown[Number(cell.dataset.note)] : null;
  };

  function look(note) {
    if (note === null) return;
    looked = note;
    told(note);
  }

  // around the picture: Chromium makes a picture that listens to the focus a stop of Tab
  const room = h("div", { class: "neck-map-room" }, svg);
  for (const type of ["pointerover", "focusin"]) room.addEventListener(type, (event) => look(noteAt(event.target)));
  room.addEventListener("pointerleave", () => {
    if (svg.contains(document.activeElement)) look(noteAt(document.activeElement));
  });
  room.addEventListener("click", (event) => {
    const note = noteAt(event.target);
    if (note === null) return;
    event.target.closest("[data-note]").focus();
    hear(note, { threshold: event.shiftKey });
  });
  room.addEventListener("keydown", (event) => {
    const note = noteAt(event.target);
    if (note === null || event.repeat || (event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    event.stopPropagation(); // the space bar is a pedal elsewhere
    hear(note, { threshold: event.shiftKey });
  });
  const settle = grid(room);

  function draw() {
    if (shown === null || !width) return;
    const focused = svg.contains(document.activeElement) ? document.activeElement.dataset.note : undefined;
    const strings = [...new Set(shown.map(stringOf))];
    const frets = Math.max(...shown.map(({ fret }) => fret));
    const names = strings.map((string) => shown.find((note) => stringOf(note) === string).string);
    const { size, columns, box, left } = frets > 0 ? alongNeck(strings, names, frets, width) : sideBySide(strings, names, width);
    svg.setAttribute("width", size.width);
    svg.setAttribute("height", size.height);
    svg.setAttribute("viewBox", `0 0 ${size.width} ${size.height}`);
    const heads = columns.map(({ x, y, text }) => s("text", { class: "tick", x, y, "text-anchor": "middle" }, text));
    const rows = (frets > 0 ? [...strings].reverse() : [null]).map((string) => {
      const own = shown.filter((note) => string === null || stringOf(note) === string);
      const label = string === null ? "Open strings" : `${own[0].string} string`;
      const name = string === null ? null : s("text", { class: "neck-map-name", x: left - 10, y: box(own[0]).y + ROW / 2 + 4, "text-anchor": "end" }, own[0].string);
      return s("g", { role: "row", "aria-label": label }, name, ...own.map((note) => cell(note, box(note))));
    });
    const nut = frets > 0 ? s("line", { class: "nut", x1: left + OPEN + NUT / 2, x2: left + OPEN + NUT / 2, y1: 2, y2: size.height - FOOT - 2 }) : null;
    svg.replaceChildren(s("g", { "aria-hidden": "true" }, ...heads, ...(nut ? [nut] : [])), ...rows);
    settle();
    if (focused !== undefined) svg.querySelector(`[data-note="${focused}"]`)?.focus({ preventScroll: true });
  }

  function cell(note, { x, y, w, h: high }) {
    const kind = resting(note) ? "rests" : silent(note) ? "clear" : "buzzes";
    const colours = kind === "buzzes" ? shade(note.buzz_mm / note.stroke_mm, dark) : null;
    const first = kind === "clear" ? "–" : short(resting(note) ? note.touches : note.buzzes_on);
    const second = marks(note);
    const letters = `neck-map-text${colours ? (colours.light ? " pale" : " deep") : ""}`;
    const middle = x + w / 2;
    return s(
      "g",
      {
        class: `neck-map-cell ${kind}`,
        role: "gridcell",
        tabindex: -1,
        "data-note": shown.indexOf(note),
        "data-row": y,
        "data-column": x,
        "aria-label": `${where(note)}: ${inWords(note)}`,
      },
      s("rect", { x: x + 0.5, y: y + 1, width: Math.max(1, w - 1), height: high - 2, rx: 2, fill: colours?.fill ?? null }),
      s("text", { class: letters, x: middle, y: y + high / 2 + (second ? -1 : 4), "text-anchor": "middle" }, first),
      second ? s("text", { class: `${letters} mark`, x: middle, y: y + high / 2 + 13, "text-anchor": "middle" }, second) : null,
    );
  }

  new ResizeObserver(() => {
    if (!room.clientWidth || room.clientWidth === width) return;
    width = room.clientWidth;
    draw();
  }).observe(room);

  return {
    element: room,
    get looked() {
      return looked;
    },
    show(notes, onDark) {
      if (notes !== shown) looked = null;
      shown = notes;
      dark = onDark;
      if (notes === null) svg.replaceChildren();
      else draw();
    },
  };
}

/** Where cells of strings with frets lie: {size, columns: texts below them, box(note), left: where the open string begins}. */
function alongNeck(strings, names, frets, room) {
  const left = MARGINS + LETTER * Math.max(...names.map((name) => name.length));
  const share = (fret) => 1 - 2 ** (-fret / 12);
  const last = share(frets) - share(frets - 1);
  const long = Math.max(room - left - OPEN - NUT, (NARROWEST * share(frets)) / last);
  const x = (fret) => left + OPEN + NUT + (long * share(fret)) / share(frets);
  const height = strings.length * ROW;
  const from = (fret) => (fret === 0 ? left : x(fret - 1));
  const wide = (fret) => (fret === 0 ? OPEN : x(fret) - x(fret - 1));
  return {
    left,
    size: { width: Math.floor(left + OPEN + NUT + long), height: height + FOOT },
    columns: Array.from({ length: frets + 1 }, (_, fret) => ({
      x: from(fret) + wide(fret) / 2,
      y: height + 14,
      text: fret === 0 ? "open" : String(fret),
    })),
    box: (note) => ({ x: from(note.fret), y: (strings.length - 1 - strings.indexOf(stringOf(note))) * ROW, w: wide(note.fret), h: ROW }),
  };
}

/** The same of strings without frets, with their names below them. */
function sideBySide(strings, names, room) {
  const wide = Math.max(LEAST_OPEN, Math.min(MOST_OPEN, room / strings.length));
  const at = (string) => strings.indexOf(string) * wide;
  return {
    size: { width: Math.ceil(wide * strings.length), height: ROW + FOOT },
    columns: names.map((text, i) => ({ x: (i + 0.5) * wide, y: ROW + 14, text })),
    box: (note) => ({ x: at(stringOf(note)), y: 0, w: wide, h: ROW }),
  };
}
