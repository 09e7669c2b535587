// Draws what GET …/instrument describes into a panel: nut, string, neck, bridge, finger, pluck, pickup.

import { s, same } from "./format.js";

/** Frets that have a dot on many necks. */
const MARKED_FRETS = [3, 5, 7, 9, 12, 15, 17, 19, 21, 24];
/** Frets that a swinging string does not touch: how tall, how far below the string, how far apart their numbers are [px]. */
const FRET_PX = 16;
const FRET_GAP_PX = 8;
const FRET_NUMBER_PX = 17;

/** What the whole-string panel shows: everything, with room above and below. */
export function wholeView(drawing, film) {
  const [low, high] = drawing.extent_mm;
  const [least, most] = film?.height_mm ?? [0, 0];
  const top = Math.max(high, most, 0.2);
  const bottom = Math.min(low, least, -0.55 * top);
  const x1 = drawing.open_length_m;
  return { x0: -0.012 * x1, x1: 1.015 * x1, y0: bottom - 0.14 * (top - bottom), y1: top + 0.14 * (top - bottom) };
}

/** What the close-up shows, or null where the whole string shows it all: the points near an end, to µm. */
export function closeView(drawing) {
  const length = drawing.open_length_m;
  const near = drawing.points.filter(({ x }) => x > 0.94 * length);
  if (drawing.kind === "frets" || near.length === 0) return null;
  const far = Math.max(...near.map(({ x }) => length - x));
  const deep = Math.max(...near.map(({ height }) => Math.abs(height)), Math.abs(drawing.thread?.height ?? 0));
  // the string, drawn aside, leaves its rest by its slope times the distance
  const slope = drawing.pluck.displacement_mm / Math.max(0.05 * length, length - drawing.pluck.x);
  const high = Math.max(3 * deep, Math.min(1.6 * slope * far, 40 * Math.max(deep, 0.002)), 0.012);
  return { x0: length - 3 * far, x1: length + 0.5 * far, y0: -Math.max(0.5 * high, 1.5 * deep), y1: high };
}

/** `ghost`: the same of the saved version, drawn behind where it differs, or null. */
export function drawScene(panel, drawing, { close, ghost }) {
  const { X, Y, bottom } = panel;
  const { open_length_m: length, kind } = drawing;
  const back = [];
  const front = [];

  // nut
  if (panel.shows(0)) {
    back.push(s("path", { class: "wood", d: `M${X(0)} ${Y(0)}h-9v${bottom - Y(0)}h13z` }));
  }
  // a string may have no fret and no point of the bridge under it
  const bare = drawing.points.length === 0;
  if (kind === "bridge" && !bare) back.push(...bridge(panel, drawing));
  else {
    const x = X(length);
    back.push(s("path", { class: "wood", d: `M${x} ${Y(0)}h9v${bottom - Y(0)}h-15z` }));
  }
  if (kind === "frets" && !bare) back.push(...neck(panel, drawing));
  else if (drawing.frets.length > 0 && !close && !bare) back.push(...frets(panel, drawing));
  if (drawing.board.length > 0) {
    const surface = drawing.board.map(([x, height]) => `L${X(x)} ${Y(height)}`).join("");
    const [first, last] = [drawing.board[0][0], drawing.board.at(-1)[0]];
    back.push(s("path", { class: "wood", d: `M${X(first)} ${bottom}${surface}L${X(last)} ${bottom}z` }));
  }
  if (kind === "points") {
    for (const { x, height } of drawing.points) {
      if (panel.shows(x)) back.push(s("path", { class: "wood", d: `M${X(x)} ${Y(height)}l5 9V${bottom}h-10V${Y(height) + 9}z` }));
    }
  }
  if (drawing.output.height !== null && !close) back.push(...magnet(panel, drawing.output));

  if (ghost !== null) front.push(...ghostOf(panel, drawing, ghost, close));
  front.push(s("polyline", { class: "string-rest", points: panel.line(drawing.rest) }));
  front.push(s("polyline", { class: "string-drawn", points: panel.line(drawing.pluck.shape) }));
  if (drawing.finger !== null) {
    const { x, height } = drawing.finger;
    front.push(s("ellipse", { class: "finger", cx: X(x) - 9, cy: Y(height) - 9, rx: 9, ry: 10 }));
  }
  panel.back.replaceChildren(...back);
  panel.front.replaceChildren(...front);
}

function ghostOf(panel, drawing, ghost, close) {
  const out = [];
  if (!same(drawing.pluck.shape, ghost.pluck.shape)) {
    out.push(s("polyline", { class: "ghost", points: panel.line(ghost.pluck.shape) }));
  }
  for (const [i, { x, height }] of ghost.points.entries()) {
    const now = drawing.points[i];
    if (now?.x === x && now?.height === height) continue;
    if (panel.shows(x)) out.push(s("circle", { class: "ghost", cx: panel.X(x), cy: panel.Y(height), r: 4.5 }));
  }
  if (ghost.thread !== null && ghost.thread.height !== drawing.thread?.height && panel.shows(ghost.thread.x)) {
    out.push(s("circle", { class: "ghost", cx: panel.X(ghost.thread.x), cy: panel.Y(ghost.thread.height), r: 4.5 }));
  }
  if (!close && ghost.output.x !== drawing.output.x) {
    const x = panel.X(ghost.output.x);
    const y = panel.Y(ghost.output.height ?? 0);
    out.push(s("line", { class: "ghost", x1: x, x2: x, y1: y, y2: y + 16 }));
  }
  return out;
}

/** A bridge: a curve that rises to its edge of contact, and the thread on which the string ends, where there is one. */
function bridge(panel, { points, thread, saddle, open_length_m: length }) {
  const { X, Y, bottom } = panel;
  const edge = points[0];
  const far = length - edge.x;
  const fall = (share) => edge.height - share * (panel.view.y1 - panel.view.y0);
  const top =
    thread === null
      ? points.map(({ x, height }) => `L${X(x)} ${Y(height)}`).join("")
      : `C${X(edge.x + 0.6 * far)} ${Y(edge.height)} ${X(length + 0.3 * far)} ${Y(fall(0.1))} ${X(length + 0.9 * far)} ${bottom}`;
  const d =
    `M${X(edge.x - 1.4 * far)} ${bottom}` +
    `C${X(edge.x - 1.1 * far)} ${Y(fall(0.12))} ${X(edge.x - 0.5 * far)} ${Y(edge.height)} ${X(edge.x)} ${Y(edge.height)}` +
    (thread === null ? `${top}L${X(length)} ${Y(saddle.height)}L${X(length + 0.9 * far)} ${bottom}z` : `${top}z`);
  const out = [s("path", { class: "wood rides", d })];
  if (thread === null) return out;
  const radius = Math.max(2.2, Math.min(7, Math.abs(X(length) - X(edge.x)) * 0.16));
  out.push(s("circle", { class: "thread rides", cx: X(thread.x), cy: Y(thread.height) + radius, r: radius }));
  return out;
}

/** The frets of a neck before a bridge, which stop strings and lie clear of those that swing. */
function frets(panel, { frets: places, fret, open_length_m: length }) {
  const { X, Y, bottom } = panel;
  const tall = Math.min(FRET_PX, (bottom - Y(0)) / 2);
  const top = Y(0) + FRET_GAP_PX;
  const end = Math.min(X(length), X(places.at(-1)) + 6);
  const out = [s("rect", { class: "wood", x: X(0), y: top + tall, width: end - X(0), height: Math.max(0, bottom - top - tall) })];
  let free = -Infinity;
  for (const [i, x] of places.entries()) {
    const number = i + 1;
    out.push(s("line", { class: number === fret ? "fret" : "fret past", x1: X(x), x2: X(x), y1: top, y2: top + tall }));
    if (X(x) < free) continue;
    free = X(x) + FRET_NUMBER_PX;
    const marked = number === fret || MARKED_FRETS.includes(number);
    const y = Math.min(bottom - 5, top + tall + 13);
    out.push(s("text", { class: marked ? "fret-number marked" : "fret-number", x: X(x), y, "text-anchor": "middle" }, String(number)));
  }
  return out;
}

/** Board and frets; those that the note cannot touch are pale. */
function neck(panel, { points, open_length_m: length }) {
  const { X, Y, bottom } = panel;
  const depth = 0.1 * (panel.view.y1 - panel.view.y0);
  const last = points.at(-1);
  const end = Math.min(length, last.x + 0.5 * (last.x - (points.at(-2)?.x ?? 0)));
  const top = [[0, points[0].height], ...points.map(({ x, height }) => [x, height]), [end, last.height]];
  const board = top.map(([x, h]) => `${X(x)},${Y(h - depth)}`).join(" ");
  const out = [s("polygon", { class: "wood", points: `${X(0)},${bottom} ${board} ${X(end)},${bottom}` })];
  const sparse = X(points.at(-1).x) - X(points.at(-2)?.x ?? 0) < 16;
  for (const [i, { x, height, in_play: inPlay }] of points.entries()) {
    out.push(s("line", { class: inPlay ? "fret" : "fret past", x1: X(x), x2: X(x), y1: Y(height), y2: Y(height - depth) + 3 }));
    if (!sparse || (i + 1) % 2 === 1 || i === 11) {
      const marked = MARKED_FRETS.includes(i + 1);
      const y = Math.min(bottom - 5, Y(height - depth) + 18);
      if (!sparse || marked) out.push(s("text", { class: marked ? "fret-number marked" : "fret-number", x: X(x), y, "text-anchor": "middle" }, String(i + 1)));
    }
  }
  return out;
}

function magnet(panel, { x, height, width_m: width }) {
  const { X, Y, bottom } = panel;
  const half = Math.max(5, (X(x + width / 2) - X(x - width / 2)) / 2);
  const top = Y(height);
  const depth = Math.max(10, Math.min(34, bottom - top));
  return [
    s("rect", { class: "coil", x: X(x) - half - 4, y: top + 5, width: 2 * half + 8, height: depth - 5, rx: 2 }),
    s("rect", { class: "magnet", x: X(x) - half, y: top, width: 2 * half, height: depth, rx: 1.5 }),
  ];
}

/** The handles of a panel, as `makeHandles` shows them. */
export function handlesOf(panel, drawing, { close, hasClose }) {
  const out = [];
  const { pluck, output } = drawing;
  if (!close) {
    const crest = pluck.shape.at(-2)[1];
    const half = Math.max(4, (panel.X(pluck.width_m) - panel.X(0)) / 2);
    out.push({
      id: "pluck",
      x: pluck.x,
      y: crest,
      label: "Pluck",
      drag: pluck.drag,
      shape: [
        s("line", { class: "pluck-width", x1: -half, x2: half, y1: -5, y2: -5 }),
        s("path", { class: "pluck", d: "M0 -4C-8 -12 -8 -22 0 -22S8 -12 0 -4Z" }),
      ],
    });
  }
  for (const point of drawing.points) {
    const here = close || !hasClose || point.x < panel.view.x1 - 0.06 * (panel.view.x1 - panel.view.x0);
    if (!here || !panel.shows(point.x) || !(point.drag.x || point.drag.height)) continue;
    const neck = drawing.kind === "frets";
    out.push({
      id: `point-${point.index}`,
      x: point.x,
      y: point.height,
      label: point.label,
      row: neck,
      past: !point.in_play,
      drag: point.drag,
      shape: [s("circle", { class: neck ? "knob small" : "knob", r: neck ? 3.2 : 5 })],
    });
  }
  if (drawing.thread !== null && close === hasClose) {
    out.push({
      id: "thread",
      x: drawing.thread.x,
      y: drawing.thread.height,
      label: "Thread (jiva)",
      drag: drawing.thread.drag,
      shape: [s("circle", { class: "knob", r: 5 })],
    });
  }
  if (!close && output.drag.x) {
    const pickup = output.height !== null;
    out.push({
      id: "output",
      x: output.x,
      y: pickup ? output.height : 0,
      label: pickup ? "Pickup" : "Heard at",
      drag: output.drag,
      shape: pickup ? [s("rect", { class: "knob", x: -6, y: -3, width: 12, height: 6, rx: 2 })] : [s("path", { class: "ear", d: "M0 7l6 10h-12z" })],
    });
  }
  return out;
}
