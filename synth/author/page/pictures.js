// The pictures of the analysis: functions that make a drawing from data, draw(pen, box) -> reading(x, y).
// Times in s, frequencies in Hz, levels in dB. `other` is the version compared with, where there is one.

import { differenceRamp, levelRamp, sample } from "./colour.js";
import { axes, clipped, hertz, linear, logarithmic, polyline, seconds, short, signed, theme } from "./figure.js";
import { number } from "./format.js";

/** Width that a scale of colours takes at the right of a picture. */
const SCALE = 58;
/** Contacts over time: width of a column, and how many between two contacts are too few to tell them apart. */
const COLUMN = 2;
const NEAR = 2;

const inside = (box, x, y) => x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;

/** The largest of 1, 2, 5 times a power of ten that is not above a value. */
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return Number((power * [5, 2, 1].find((digit) => digit * power <= value * 1.000001)).toPrecision(6));
}

/** wave {bin_s, low, high}: the lowest and highest sample of every bin; other likewise, drawn as an outline. */
export function waveform(wave, other = null, length_s = wave.bin_s * wave.low.length) {
  const top =
    1.05 * Math.max(1e-6, ...wave.high.map(Math.abs), ...wave.low.map(Math.abs), ...(other?.high ?? []).map(Math.abs));
  return (pen, whole) => {
    const colours = theme();
    const box = { ...whole, right: whole.right - SCALE };
    const x = linear(0, length_s, box.left, box.right);
    const y = linear(-top, top, box.bottom, box.top);
    const mark = roundBelow(top);
    axes(pen, box, { x, y: { ...y, ticks: () => [-mark, 0, mark] }, xName: "s", yName: "of full scale" });
    const area = ({ bin_s, low, high }) => {
      pen.beginPath();
      high.forEach((value, i) => pen.lineTo(x.at((i + 0.5) * bin_s), y.at(value)));
      for (let i = low.length - 1; i >= 0; i--)
        pen.lineTo(x.at((i + 0.5) * bin_s), Math.max(y.at(low[i]), y.at(high[i]) + 1));
      pen.closePath();
    };
    clipped(pen, box, () => {
      pen.fillStyle = colours.accent;
      area(wave);
      pen.fill();
      if (other) {
        pen.strokeStyle = colours.second;
        area(other);
        pen.stroke();
      }
    });
    return (px, py) => {
      if (!inside(box, px, py)) return null;
      const i = Math.floor(x.invert(px) / wave.bin_s);
      const peak = Math.max(Math.abs(wave.low[i] ?? 0), Math.abs(wave.high[i] ?? 0));
      return `${seconds(x.invert(px))}: ${peak > 0 ? `${number(20 * Math.log10(peak), 3)} dBFS` : "silence"}`;
    };
  };
}

/** Where a frequency lies among rising rows, as a fraction of their number; the rows are as far apart as they may be. */
function rowAt(hz, frequency) {
  let [low, high] = [0, hz.length - 1];
  if (frequency <= hz[low]) return low;
  if (frequency >= hz[high]) return high;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (hz[middle] <= frequency) low = middle;
    else high = middle;
  }
  return low + (frequency - hz[low]) / (hz[high] - hz[low]);
}

/** Rows of bytes as a picture: the ramp's colours from byte `least` on, rows where y has their frequencies. */
function painted({ rows, hz }, ramp, y, height, least) {
  const columns = rows[0].length;
  const canvas = new OffscreenCanvas(columns, height);
  const pen = canvas.getContext("2d");
  const picture = pen.createImageData(columns, height);
  for (let line = 0; line < height; line++) {
    const place = rowAt(hz, y.invert(y.to + line + 0.5));
    const below = Math.floor(place);
    const above = Math.min(hz.length - 1, below + 1);
    for (let column = 0; column < columns; column++) {
      const value = rows[below][column] + (place - below) * (rows[above][column] - rows[below][column]);
      const colour = 3 * Math.round(255 * Math.max(0, (value - least) / (255 - least)));
      const at = 4 * (line * columns + column);
      picture.data[at] = ramp[colour];
      picture.data[at + 1] = ramp[colour + 1];
      picture.data[at + 2] = ramp[colour + 2];
      picture.data[at + 3] = 255;
    }
  }
  pen.putImageData(picture, 0, 0);
  return canvas;
}

/**
 * image {start_s, step_s: centres of columns, hz: of the rows, rising, rows: [[0…255 per column]], floor_db, top_db}.
 *
 * formant: [{t_s, hz}], drawn over it; log: frequency axis; high_hz: its end; length_s: of the time axis; range_db: what is
 * so far below the top is paper; difference: the bytes are differences, floor_db … top_db with 0 in the middle.
 */
export function spectrogram(image, options = {}) {
  const { formant = null, log = false, high_hz = 10000, difference = false, length_s = null, range_db = Infinity } = options;
  const { start_s, step_s, hz, rows } = image;
  const lowest = Math.max(image.floor_db, image.top_db - range_db);
  const least = (255 * (lowest - image.floor_db)) / (image.top_db - image.floor_db);
  return (pen, box) => {
    const colours = theme();
    const ramp = difference ? differenceRamp(colours.dark) : levelRamp(colours.dark);
    const [begin, end] = [start_s - step_s / 2, start_s + (rows[0].length - 0.5) * step_s];
    const top = Math.min(high_hz, hz.at(-1));
    const plot = { ...box, right: box.right - SCALE };
    const x = linear(0, length_s ?? end, plot.left, plot.right);
    const y = log ? logarithmic(hz[0], top, plot.bottom, plot.top) : linear(0, top, plot.bottom, plot.top);
    const height = Math.max(1, Math.round(plot.bottom - plot.top));
    pen.imageSmoothingEnabled = true;
    pen.imageSmoothingQuality = "high";
    const painting = painted(image, ramp, y, height, least);
    clipped(pen, plot, () =>
      pen.drawImage(painting, x.at(begin), plot.top, x.at(end) - x.at(begin), plot.bottom - plot.top),
    );
    axes(pen, plot, {
      x,
      y,
      xName: "s",
      yName: "Hz",
      lines: false,
      yFormat: (v) => (v >= 1000 ? `${short(v / 1000)}k` : short(v)),
    });
    levelScale(pen, box, ramp, [lowest, image.top_db], difference ? "dB apart" : "dB");
    if (formant?.length) {
      const halo = colours.dark ? "rgb(0 0 0 / 65%)" : "rgb(255 255 255 / 75%)";
      clipped(pen, plot, () => {
        pen.lineJoin = "round";
        for (const [width, colour] of [
          [4, halo],
          [1.75, colours.second],
        ]) {
          pen.lineWidth = width;
          pen.strokeStyle = colour;
          polyline(
            pen,
            formant.map((p) => p.t_s),
            formant.map((p) => p.hz),
            x,
            y,
          );
        }
      });
    }
    return (px, py) => {
      if (!inside(plot, px, py)) return null;
      const [t, frequency] = [x.invert(px), y.invert(py)];
      const column = Math.round((t - start_s) / step_s);
      const byte = rows[Math.round(rowAt(hz, frequency))][Math.max(0, Math.min(rows[0].length - 1, column))];
      const level = image.floor_db + (byte / 255) * (image.top_db - image.floor_db);
      return `${seconds(t)}, ${hertz(frequency)}: ${difference ? signed(level, 2) : number(level, 3)} dB`;
    };
  };
}

function levelScale(pen, box, ramp, [floor_db, top_db], unit) {
  const colours = theme();
  const left = box.right - SCALE + 12;
  const y = linear(floor_db, top_db, box.bottom, box.top + 14);
  for (let line = Math.floor(y.to); line < y.from; line++) {
    pen.fillStyle = sample(ramp, (y.invert(line) - floor_db) / (top_db - floor_db));
    pen.fillRect(left, line, 10, 1.5);
  }
  pen.font = colours.font;
  pen.fillStyle = colours.muted;
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  for (const value of y.ticks((y.from - y.to) / 34)) pen.fillText(short(value), left + 14, y.at(value));
  pen.fillText(unit, left, box.top + 4);
}

function dot(pen, x, y, radius, filled = true) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  if (filled) pen.fill();
  else pen.stroke();
}

/** Nearest of several places to a point, within 24 px: its index or null. */
function nearest(places, px, py) {
  let [best, far] = [null, 24];
  places.forEach((place, i) => {
    if (!place) return;
    const away = Math.hypot(place[0] - px, place[1] - py);
    if (away < far) [best, far] = [i, away];
  });
  return best;
}

const strength = (partials) => {
  const top = Math.max(...partials.map((p) => p.level_db ?? -200));
  return (p) => 2 + 2.5 * Math.max(0, Math.min(1, 1 + ((p.level_db ?? -200) - top) / 60));
};

/** partials [{number, model_hz, measured_hz, cents, level_db}]: how far each sounds from where the model has it. */
export function deviations(partials, other = null) {
  const shown = partials.filter((p) => p.cents !== null);
  const reach = Math.max(2, ...[...shown, ...(other ?? [])].map((p) => 1.15 * Math.abs(p.cents ?? 0)));
  const size = strength(partials);
  return (pen, box) => {
    const colours = theme();
    const x = linear(0, Math.max(8, ...partials.map((p) => p.number)) + 1, box.left, box.right);
    const y = linear(-reach, reach, box.bottom, box.top);
    axes(pen, box, { x, y, xName: "partial", yName: "cents", yFormat: (v) => signed(v) });
    pen.strokeStyle = colours.second;
    pen.lineWidth = 1.25;
    polyline(pen, [x.low, x.high], [0, 0], x, y);
    pen.strokeStyle = colours.second;
    for (const p of other ?? []) if (p.cents !== null) dot(pen, x.at(p.number), y.at(p.cents), 3, false);
    const places = shown.map((p) => [x.at(p.number), y.at(p.cents)]);
    pen.fillStyle = colours.accent;
    shown.forEach((p, i) => dot(pen, ...places[i], size(p)));
    return (px, py) => {
      const i = nearest(places, px, py);
      return i === null
        ? null
        : `${shown[i].number}: ${number(shown[i].measured_hz, 6)} Hz, ${signed(shown[i].cents)} cents`;
    };
  };
}

/**
 * The same partials' decay times, measured (dots) and of the model (line), over frequency.
 *
 * longest_s: a decay measured as longer is drawn hollow and grey and does not count for the scale.
 */
export function decays(partials, other = null, longest_s = Infinity) {
  const known = partials.filter((p) => p.model_t60_s > 0 || p.measured_t60_s > 0);
  const unsure = (p) => p.measured_t60_s > longest_s;
  const times = [...known, ...(other ?? [])]
    .flatMap((p) => [p.model_t60_s, unsure(p) ? null : p.measured_t60_s])
    .filter((t) => t > 0);
  const size = strength(partials);
  return (pen, box) => {
    const colours = theme();
    if (times.length === 0) return empty(pen, box, "No partial's decay could be measured");
    const frequencies = known.map((p) => p.measured_hz ?? p.model_hz);
    const x = logarithmic(0.8 * Math.min(...frequencies), 1.2 * Math.max(...frequencies), box.left, box.right);
    const y = logarithmic(0.7 * Math.min(...times), 1.4 * Math.max(...times), box.bottom, box.top);
    axes(pen, box, { x, y, xName: "Hz", yName: "T60, s", xFormat: (v) => (v >= 1000 ? `${short(v / 1000)}k` : short(v)) });
    pen.strokeStyle = colours.second;
    pen.lineWidth = 1.75;
    polyline(
      pen,
      known.map((p) => p.model_hz),
      known.map((p) => p.model_t60_s),
      x,
      y,
    );
    for (const p of other ?? [])
      if (p.measured_t60_s > 0 && !unsure(p)) dot(pen, x.at(p.measured_hz), y.at(p.measured_t60_s), 3, false);
    // what is beyond the scale lies at its edge
    const places = known.map((p) =>
      p.measured_t60_s > 0
        ? [x.at(p.measured_hz ?? p.model_hz), Math.max(box.top + 4, y.at(p.measured_t60_s))]
        : null,
    );
    pen.fillStyle = colours.accent;
    pen.strokeStyle = colours.muted;
    pen.lineWidth = 1.25;
    known.forEach((p, i) => places[i] && dot(pen, ...places[i], unsure(p) ? 2.5 : size(p), !unsure(p)));
    return (px, py) => {
      const i = nearest(places, px, py);
      if (i === null) return null;
      const p = known[i];
      const doubt = unsure(p) ? " (too little decay to be sure)" : "";
      return `${p.number}: ${seconds(p.measured_t60_s)}${doubt}, model ${p.model_t60_s > 0 ? seconds(p.model_t60_s) : "–"}`;
    };
  };
}

export function empty(pen, box, words) {
  const colours = theme();
  pen.font = colours.font;
  pen.fillStyle = colours.muted;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(words, (box.left + box.right) / 2, (box.top + box.bottom) / 2);
  return null;
}

/**
 * When each point is touched, and how hard, in rows by point.
 *
 * points [{label}] from the nut; spans [{row, start_s, end_s, peak_n}], row among the points; length_s of the time axis.
 * Contacts so close that single ones cannot be told apart, or closer than gap_s, are one strip, as strong as its weaker side.
 */
export function contactTimeline(points, spans, length_s, gap_s = 0) {
  const hardest = Math.max(1e-9, ...spans.map((span) => span.peak_n));
  return (pen, box) => {
    const colours = theme();
    const plot = { ...box, right: box.right - SCALE };
    const ramp = levelRamp(colours.dark);
    const x = linear(0, length_s, plot.left, plot.right);
    const row = (plot.bottom - plot.top) / Math.max(1, points.length);
    const brief = length_s < 0.5;
    axes(pen, plot, { x, xName: brief ? "ms" : "s", xFormat: brief ? (v) => short(1000 * v) : short });
    pen.font = colours.font;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillStyle = colours.muted;
    const every = Math.ceil(13 / row);
    points.forEach(({ label }, i) => {
      if (i % every === 0) pen.fillText(label, plot.left - 7, plot.top + (i + 0.5) * row, plot.left - 4);
    });
    clipped(pen, plot, () => {
      const gap = Math.max(NEAR, Math.ceil((x.at(gap_s) - plot.left) / COLUMN));
      columnsOf(spans, points.length, x, length_s).forEach((peaks, i) => {
        bridged(peaks, gap).forEach((peak, column) => {
          if (peak === 0) return;
          pen.fillStyle = sample(ramp, 0.25 + 0.75 * Math.sqrt(peak / hardest));
          pen.fillRect(plot.left + column * COLUMN, plot.top + i * row + 1, COLUMN, Math.max(1, row - 2));
        });
      });
    });
    forceScale(pen, box, ramp, hardest);
    return (px, py) => {
      if (!inside(plot, px, py)) return null;
      const at = Math.min(points.length - 1, Math.floor((py - plot.top) / row));
      const t = x.invert(px);
      const slack = (2 * length_s) / (plot.right - plot.left);
      const hit = spans.find((span) => span.row === at && t >= span.start_s - slack && t <= span.end_s + slack);
      const { label } = points[at];
      if (!hit) return `${label} at ${seconds(t)}: free`;
      return `${label} at ${seconds(hit.start_s)} for ${seconds(hit.end_s - hit.start_s)}: up to ${number(hit.peak_n, 3)} N`;
    };
  };
}

/** The largest force in every column of pixels, by rows. */
function columnsOf(spans, rows, x, length_s) {
  const count = Math.max(1, Math.ceil((x.to - x.from) / COLUMN));
  const found = Array.from({ length: rows }, () => new Float64Array(count));
  const column = (time_s) => Math.max(0, Math.min(count - 1, Math.floor((x.at(time_s) - x.from) / COLUMN)));
  for (const { row, start_s, end_s, peak_n } of spans) {
    if (start_s > length_s) continue;
    for (let at = column(start_s), last = column(end_s); at <= last; at++) found[row][at] = Math.max(found[row][at], peak_n);
  }
  return found;
}

/** With gaps of up to `gap` columns closed. */
function bridged(peaks, gap) {
  const closed = Float64Array.from(peaks);
  let before = -1;
  peaks.forEach((peak, at) => {
    if (peak === 0) return;
    if (before >= 0 && at - before <= gap + 1) closed.fill(Math.min(peak, peaks[before]), before + 1, at);
    before = at;
  });
  return closed;
}

function forceScale(pen, box, ramp, hardest) {
  const colours = theme();
  const left = box.right - SCALE + 12;
  const y = linear(0, 1, box.bottom, box.top + 20);
  for (let line = Math.floor(y.to); line < y.from; line++) {
    pen.fillStyle = sample(ramp, 0.25 + 0.75 * Math.sqrt(y.invert(line)));
    pen.fillRect(left, line, 10, 1.5);
  }
  pen.font = colours.font;
  pen.fillStyle = colours.muted;
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  for (const share of [0, 0.5, 1]) pen.fillText(number(share * hardest, 2), left + 14, y.at(share));
  pen.fillText("N, peak", left - 4, box.top + 4);
}

/**
 * Points and a fitted line: {points: [[x, y]], line: [[x, y]], xName, yName, log (both axes), logX (that one), say(x, y) for
 * the reading}.
 * Points that the fit left aside, `aside`, are drawn hollow.
 */
export function fitted({ points, line, aside = [], xName, yName, log = false, logX = log, say }) {
  return (pen, box) => {
    const colours = theme();
    const all = [...points, ...line, ...aside].filter(([, y]) => Number.isFinite(y) && (!log || y > 0));
    if (points.length === 0) return empty(pen, box, "No partial could be measured");
    const [xs, ys] = [all.map(([x]) => x), all.map(([, y]) => y)];
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const margin = 0.08 * (high - low) || 1;
    const across = logX ? logarithmic(0.85 * left, 1.15 * right, box.left, box.right) : linear(0, right + 1, box.left, box.right);
    const x = { ...across, ticks: () => across.ticks(Math.max(4, (box.right - box.left) / 50)) }; // the pictures are narrow
    const y = log
      ? logarithmic(0.75 * low, 1.35 * high, box.bottom, box.top)
      : linear(low - margin, high + margin, box.bottom, box.top);
    const xFormat = logX ? (v) => (v >= 1000 ? `${short(v / 1000)}k` : short(v)) : short;
    axes(pen, box, { x, y, xName, yName, xFormat });
    pen.strokeStyle = colours.second;
    pen.lineWidth = 1.75;
    clipped(pen, box, () =>
      polyline(
        pen,
        line.map(([v]) => v),
        line.map(([, v]) => v),
        x,
        y,
      ),
    );
    pen.strokeStyle = colours.muted;
    pen.lineWidth = 1.25;
    for (const [u, v] of aside) dot(pen, x.at(u), y.at(v), 3, false);
    const places = points.map(([u, v]) => [x.at(u), y.at(v)]);
    pen.fillStyle = colours.accent;
    for (const place of places) dot(pen, ...place, 3.25);
    return (px, py) => {
      const i = nearest(places, px, py);
      return i === null ? null : say(...points[i]);
    };
  };
}

/** Lines over the same time: {start_s, step_s, lines: [{values, colour (name of the theme's), width, name}]}. */
export function curves({ start_s, step_s, lines }) {
  const top = 1.08 * Math.max(1e-9, ...lines.flatMap(({ values }) => values.map(Math.abs)));
  const length = lines[0].values.length;
  return (pen, whole) => {
    const colours = theme();
    const box = { ...whole, right: whole.right - SCALE };
    const x = linear(start_s, start_s + length * step_s, box.left, box.right);
    const y = linear(-top, top, box.bottom, box.top);
    axes(pen, box, { x, y, xName: "ms", xFormat: (v) => short(1000 * v) });
    clipped(pen, box, () => {
      for (const { values, colour, width } of lines) {
        pen.strokeStyle = colours[colour];
        pen.lineWidth = width;
        pen.lineJoin = "round";
        pen.beginPath();
        values.forEach((value, i) => pen.lineTo(x.at(start_s + i * step_s), y.at(value)));
        pen.stroke();
      }
    });
    pen.font = colours.font;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    lines.forEach(({ colour, name }, i) => {
      pen.fillStyle = colours[colour];
      pen.fillText(name, box.right + 6, box.top + 8 + 15 * i);
    });
    return (px, py) => {
      if (!inside(box, px, py)) return null;
      const i = Math.max(0, Math.min(length - 1, Math.round((x.invert(px) - start_s) / step_s)));
      return `${seconds(x.invert(px))}: ${lines.map(({ values, name }) => `${name} ${number(values[i], 2)}`).join(", ")}`;
    };
  };
}
