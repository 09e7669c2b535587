// The bridge seen along the strings: strings at their places on it, bridge and strings in slow motion, a meter for each string.

import { h, number, s } from "./format.js";

/** What levels are shown down to, re the loudest string [dB]. */
const FLOOR_DB = 90;
const SIZE = { width: 520, height: 250 };
const EDGE = 56;
const BRIDGE = { y: 128, thick: 12 };
const STRING_Y = 62;
/** How far the bridge is drawn to move at most, and a string that is as loud as the loudest [px]. */
const BRIDGE_PX = 16;
const SWING_PX = 30;
const METER = { top: 164, height: 50, width: 12 };
/** Names stand this far apart, upright where all have room for them lying; the room that upright ones take [px]. */
const NAME_PX = 12;
const LETTER_PX = 6.2;
const UPRIGHT_PX = 66;
/** Bars a level is read aloud in. */
const SAID_DB = 3;

export function makeBridge() {
  const svg = s("svg", {
    class: "stage-bridge",
    viewBox: `0 0 ${SIZE.width} ${SIZE.height}`,
    role: "group",
    "aria-label": "The bridge, seen along the strings",
  });
  const caption = h("figcaption");
  const element = h("figure", { class: "stage bridge" }, caption, svg);
  let strings = [];
  let marks = [];
  let wood = null;
  let orbits = { film: null, paths: [] };

  /** Places [px]: as given, or evenly where they are all alike. */
  function placesOf(all) {
    const given = all.map(({ place_mm: mm }) => mm);
    const [low, high] = [Math.min(...given), Math.max(...given)];
    const room = SIZE.width - 2 * EDGE;
    if (high - low < 1e-6) return all.map((_, i) => EDGE + (room * (i + 0.5)) / all.length);
    return given.map((mm) => EDGE + (room * (mm - low)) / (high - low));
  }

  function take(all) {
    strings = all;
    const xs = placesOf(all);
    const feet = apart(xs, METER.width + 3, SIZE.width);
    const widest = LETTER_PX * Math.max(...all.map(({ string }) => string.length)) + 4;
    const crowded = feet.some((x, i) => feet.some((other, j) => j !== i && Math.abs(x - other) < widest));
    svg.setAttribute("viewBox", `0 0 ${SIZE.width} ${SIZE.height + (crowded ? UPRIGHT_PX - NAME_PX : 0)}`);
    wood = s("polygon", { class: "wood" });
    marks = all.map((string, i) => {
      const x = xs[i];
      const foot = feet[i];
      const bar = s("rect", { class: "string-level", x: foot - METER.width / 2, width: METER.width, y: METER.top + METER.height, height: 0 });
      const meter = s(
        "g",
        { class: "string-meter", role: "meter", "aria-label": `${string.string} string`, "aria-valuemin": -FLOOR_DB, "aria-valuemax": 0, "aria-valuenow": -FLOOR_DB, "aria-valuetext": "at rest" },
        s("rect", { class: "string-well", x: foot - METER.width / 2, width: METER.width, y: METER.top, height: METER.height, rx: 2 }),
        bar,
      );
      const orbit = s("polyline", { class: "orbit" });
      const dot = s("circle", { class: "string-end", r: 4 });
      const lamp = s("circle", { class: "lamp", cx: x, cy: STRING_Y, r: 11 });
      const y = METER.top + METER.height + (crowded ? 8 : 16);
      const turned = crowded ? { "text-anchor": "end", "dominant-baseline": "central", transform: `rotate(-90 ${foot} ${y})` } : { "text-anchor": "middle" };
      const text = s("text", { class: "tick string-name", x: foot, y, ...turned }, string.string);
      return { string, x, bar, meter, orbit, dot, lamp, text };
    });
    svg.replaceChildren(wood, ...marks.flatMap(({ lamp, orbit, dot, meter, text }) => [lamp, orbit, dot, meter, text]));
    orbits = { film: null, paths: [] };
    rest();
  }

  function drawWood(across, up) {
    const left = EDGE - 34;
    const right = SIZE.width - EDGE + 34;
    const corners = [
      [left, BRIDGE.y, up[0]],
      [right, BRIDGE.y, up[1]],
      [right + 8, BRIDGE.y + BRIDGE.thick, up[1]],
      [left - 8, BRIDGE.y + BRIDGE.thick, up[0]],
    ];
    wood.setAttribute("points", corners.map(([x, y, rise]) => `${(x + across).toFixed(1)},${(y - rise).toFixed(1)}`).join(" "));
  }

  function rest() {
    drawWood(0, [0, 0]);
    for (const mark of marks) {
      set(mark.dot, { cx: mark.x, cy: STRING_Y });
      mark.orbit.removeAttribute("points");
      level(mark, -FLOOR_DB);
      mark.text.classList.remove("played");
    }
    caption.textContent = strings.length > 0 ? "The bridge, along the strings" : "";
  }

  function level(mark, db) {
    const share = Math.max(0, 1 + db / FLOOR_DB);
    set(mark.bar, { y: METER.top + METER.height * (1 - share), height: METER.height * share });
    mark.lamp.style.opacity = (share * share).toFixed(3);
    const said = SAID_DB * Math.round(db / SAID_DB);
    if (mark.said === said) return;
    mark.said = said;
    set(mark.meter, { "aria-valuenow": said, "aria-valuetext": said <= -FLOOR_DB ? "at rest" : `${said} dB of the loudest` });
  }

  /** Across and up, in px, of a string's two directions [mm]: as large as its level in dB, in the shape of its motion. */
  function swing(film, string, pair, largest) {
    if (!(largest > 0)) return [0, 0];
    const db = 20 * Math.log10(largest / film.swing_mm);
    const scale = (SWING_PX * Math.max(0, 1 + db / FLOOR_DB)) / largest;
    const angle = (string.angle_deg * Math.PI) / 180;
    const [along, beside] = pair;
    return [scale * (along * Math.sin(angle) + beside * Math.cos(angle)), scale * (along * Math.cos(angle) - beside * Math.sin(angle))];
  }

  /** A film's frame, with what lies between two; null: at rest. */
  function show(film, at) {
    if (strings.length === 0) return;
    const known = film?.strings?.length === strings.length ? film : null;
    if (known === null) {
      rest();
      return;
    }
    const first = Math.floor(at);
    const second = Math.min(first + 1, film.frames.length - 1);
    const between = (a, b) => a + (at - first) * (b - a);
    const of = (rows) => rows[first].map((value, i) => between(value, rows[second][i]));
    const scale = drawBridge(film, of(film.bridge.motion));
    if (orbits.film !== film) orbits = { film, paths: strings.map((string) => pathOf(film, string)) };
    for (const [i, mark] of marks.entries()) {
      const { string, largest, path } = orbits.paths[i];
      const [dx, dy] = swing(film, string, of(string.motion), largest);
      set(mark.dot, { cx: (mark.x + dx).toFixed(1), cy: (STRING_Y - dy).toFixed(1) });
      mark.orbit.setAttribute("points", path.map(([x, y]) => `${(mark.x + x).toFixed(1)},${(STRING_Y - y).toFixed(1)}`).join(" "));
      level(mark, between(string.level_db[first], string.level_db[second]));
      mark.text.classList.toggle("played", string.played);
    }
    caption.textContent = `The bridge, its motion × ${number(scale, 2)}; strings in dB`;
  }

  /** Moves it; by how much it is drawn larger than the strings' places. */
  function drawBridge(film, [normal = 0, lateral = 0, rocking = 0]) {
    const given = strings.map(({ place_mm: mm }) => mm);
    const half = Math.max(1, Math.max(...given.map(Math.abs)));
    const [most, mostLateral = 0, mostRocking = 0] = film.bridge.largest;
    // rocking in µrad, places in mm: nm
    const largest = Math.max(most + 1e-3 * mostRocking * half, mostLateral, 1e-9);
    const px = BRIDGE_PX / largest;
    drawWood(px * lateral, [-half, half].map((mm) => px * (normal + 1e-3 * rocking * mm)));
    const span = Math.max(...given) - Math.min(...given) || 60;
    return (px * 1000 * span) / (SIZE.width - 2 * EDGE);
  }

  function pathOf(film, { table, opened }) {
    const string = film.strings.find((one) => one.table === table && one.opened === opened) ?? film.strings[0];
    const largest = Math.max(...string.motion.map(([a, b]) => Math.hypot(a, b)));
    return { string, largest, path: string.motion.map((pair) => swing(film, string, pair, largest)) };
  }

  return { element, take, show };
}

/** Places moved as little as it takes to stand at least so far apart, in their order, within a width. */
export function apart(xs, least, width) {
  const order = xs.map((_, i) => i).sort((a, b) => xs[a] - xs[b]);
  const room = Math.min(least, width / xs.length);
  const out = [...xs];
  let free = room / 2;
  for (const i of order) {
    out[i] = Math.max(out[i], free);
    free = out[i] + room;
  }
  free = width - room / 2;
  for (const i of order.reverse()) {
    out[i] = Math.min(out[i], free);
    free = out[i] - room;
  }
  return out;
}

function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}
