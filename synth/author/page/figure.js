// Figures on canvas: scales with round ticks, axes, sharp lines on any screen, a reading where the pointer is.
// What is drawn is a pure function of data: draw(pen, box), all lengths in CSS pixels.

import { colour, h, number, onScheme } from "./format.js";

const STEPS = [1, 2, 5, 10];

/** Round values between two bounds, about `count` of them. */
export function ticksBetween(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * STEPS.find((s) => s * power >= rough * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

/** A linear scale from [low, high] to pixels [from, to]. */
export function linear(low, high, from, to) {
  const slope = (to - from) / (high - low || 1);
  return {
    low,
    high,
    from,
    to,
    at: (value) => from + (value - low) * slope,
    invert: (pixel) => low + (pixel - from) / slope,
    ticks: (count) => ticksBetween(low, high, count),
  };
}

/** A logarithmic scale, both bounds above 0. */
export function logarithmic(low, high, from, to) {
  const inner = linear(Math.log(low), Math.log(high), from, to);
  return {
    low,
    high,
    from,
    to,
    at: (value) => inner.at(Math.log(Math.max(value, low * 1e-6))),
    invert: (pixel) => Math.exp(inner.invert(pixel)),
    ticks: (count) => {
      const decades = Math.log10(high / low);
      const digits = count / decades >= 4 ? [1, 2, 5] : count / decades >= 1.6 ? [1, 3] : [1];
      const found = [];
      for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
        for (const digit of digits) found.push(digit * 10 ** power);
      const inside = found.map((v) => Number(v.toPrecision(6))).filter((v) => v >= low * 0.999 && v <= high * 1.001);
      return inside.length >= 2 ? inside : ticksBetween(low, high, count);
    },
  };
}

export const hertz = (value) => (value >= 1000 ? `${number(value / 1000, 3)} kHz` : `${number(value, 4)} Hz`);
export const seconds = (value) => (value < 1 ? `${number(value * 1000, 3)} ms` : `${number(value, 3)} s`);
export const signed = (value, digits = 3) => (value > 0 ? "+" : "") + number(value, digits);
export const short = (value) => number(value, 3);

let known = null;

/** The page's colours as they stand, light or dark; read once until forgetColours(). */
export function theme() {
  if (known === null) {
    known = {
      paper: colour("--sheet"),
      ink: colour("--ink"),
      muted: colour("--muted"),
      line: colour("--line"),
      frame: colour("--line-strong"),
      accent: colour("--accent"),
      second: colour("--second"),
      good: colour("--good"),
      bad: colour("--bad"),
      font: `11px ${getComputedStyle(document.body).fontFamily}`,
    };
    known.dark = /\d+/.exec(known.paper)[0] < 128;
  }
  return known;
}

const figures = new Set();

/** After a change of theme: read the colours again and draw everything again. */
export function recolour() {
  known = null;
  for (const figure of figures) figure.redraw();
}

onScheme(recolour);

/** Space for axes around the plot. */
export function inset(width, height, { left = 52, right = 10, top = 8, bottom = 22 } = {}) {
  return { left, top, right: Math.max(left + 10, width - right), bottom: Math.max(top + 10, height - bottom) };
}

/** Frame, ticks, numbers and names of the axes. `lines`: faint lines across the plot. */
export function axes(pen, box, { x, y, xName, yName, lines = true, xFormat = short, yFormat = short }) {
  const colours = theme();
  pen.save();
  pen.font = colours.font;
  pen.lineWidth = 1;
  const crisp = (v) => Math.round(v) + 0.5;
  pen.strokeStyle = colours.line;
  pen.fillStyle = colours.muted;
  const line = (x0, y0, x1, y1) => {
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x1, y1);
    pen.stroke();
  };
  if (x) {
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const room = box.right - box.left;
    const name = xName ? pen.measureText(xName).width + 6 : 0;
    for (const value of x.ticks(Math.max(2, room / 70))) {
      const at = crisp(x.at(value));
      line(at, lines ? box.top : box.bottom, at, box.bottom + 4);
      const text = xFormat(value);
      if (at + pen.measureText(text).width / 2 <= box.right - name) pen.fillText(text, at, box.bottom + 6);
    }
  }
  if (y) {
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const value of y.ticks(Math.max(3.5, (box.bottom - box.top) / 34))) {
      const at = crisp(y.at(value));
      line(box.left - 4, at, lines ? box.right : box.left, at);
      pen.fillText(yFormat(value), box.left - 7, at);
    }
  }
  pen.strokeStyle = colours.frame;
  line(crisp(box.left), box.top, crisp(box.left), box.bottom);
  line(box.left, crisp(box.bottom), box.right, crisp(box.bottom));
  pen.fillStyle = colours.muted;
  if (xName) {
    pen.textAlign = "right";
    pen.textBaseline = "top";
    pen.fillText(xName, box.right, box.bottom + 6);
  }
  if (yName) {
    pen.translate(11, box.top);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillText(yName, 0, 0);
  }
  pen.restore();
}

/** A line through points, broken where one is not a number. */
export function polyline(pen, xs, ys, x, y) {
  pen.beginPath();
  let down = false;
  xs.forEach((value, i) => {
    if (ys[i] === null || !Number.isFinite(ys[i])) {
      down = false;
      return;
    }
    if (down) pen.lineTo(x.at(value), y.at(ys[i]));
    else pen.moveTo(x.at(value), y.at(ys[i]));
    down = true;
  });
  pen.stroke();
}

/** Keep what is drawn inside the plot. */
export function clipped(pen, box, draw) {
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  pen.clip();
  draw();
  pen.restore();
}

/**
 * A canvas with a caption and a reading under the pointer.
 *
 * title, label: what is seen above it, what a screen reader says. height: in CSS pixels.
 * show(draw) keeps draw(pen, box) -> reading(px, py) | undefined, called again when size or colours change.
 * The reading is the text for a place in the plot, or null.
 */
export class Figure {
  constructor(title, { height = 180, margins = {}, label = title } = {}) {
    this.tools = h("span", { class: "plot-tools" });
    this.reading = h("span", { class: "plot-reading" });
    this.canvas = h("canvas", { role: "img", "aria-label": label });
    this.canvas.style.height = `${height}px`;
    this.element = h(
      "figure",
      { class: "plot" },
      h("figcaption", {}, h("h3", {}, title), this.reading, this.tools),
      this.canvas,
    );
    this.margins = margins;
    this.height = height;
    this.picture = null;
    this.read = null;
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    figures.add(this);
    this.canvas.addEventListener("pointermove", (event) => this.point(event));
    this.canvas.addEventListener("pointerdown", (event) => this.point(event));
    this.canvas.addEventListener("pointerleave", () => (this.reading.textContent = ""));
  }

  show(draw, label) {
    this.picture = draw;
    if (label) this.canvas.setAttribute("aria-label", label);
    this.redraw();
  }

  setHeight(height) {
    this.height = height;
    this.canvas.style.height = `${height}px`;
  }

  redraw() {
    const width = this.canvas.clientWidth;
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, this.height);
    this.read = this.picture ? this.picture(pen, inset(width, this.height, this.margins)) : null;
  }

  point(event) {
    const place = this.canvas.getBoundingClientRect();
    this.reading.textContent = this.read?.(event.clientX - place.left, event.clientY - place.top) ?? "";
  }
}
