// The pictures of the analysis: functions that make a drawing from data, draw(pen, box) -> reading(x, y).
// Times in s, frequencies in Hz, levels in dB. `other` is the version compared with, where there is one.

import { differenceRamp, levelRamp, sample } from "./colour.js";
import { axes, clipped, hertz, linear, logarithmic, polyline, seconds, short, signed, theme } from "./figure.js";
import { number } from "./format.js";

/** Width that a scale of colours takes at the right of a picture. */
const SCALE = 58;

const inside = (box, x, y) => x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;

/** wave {dt_s, low, high}: the lowest and highest sample of every dt_s; other likewise, drawn as an outline. */
export function waveform(wave, other = null, length_s = wave.dt_s * wave.low.length) {
  const top = 1.05 * Math.max(1e-6, ...wave.high.map(Math.abs), ...wave.low.map(Math.abs), ...(other?.high ?? []).map(Math.abs));
  return (pen, whole) => {
    const colours = theme();
    const box = { ...whole, right: whole.right - SCALE };
    const x = linear(0, length_s, box.left, box.right);
    const y = linear(-top, top, box.bottom, box.top);
    axes(pen, box, { x, y, xName: "s" });
    const area = ({ dt_s, low, high }) => {
      pen.beginPath();
      high.forEach((value, i) => pen.lineTo(x.at((i + 0.5) * dt_s), y.at(value)));
      for (let i = low.length - 1; i >= 0; i--) pen.lineTo(x.at((i + 0.5) * dt_s), Math.max(y.at(low[i]), y.at(high[i]) + 1));
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
      const i = Math.floor(x.invert(px) / wave.dt_s);
      const peak = Math.max(Math.abs(wave.low[i] ?? 0), Math.abs(wave.high[i] ?? 0));
      return `${seconds(x.invert(px))}: ${peak > 0 ? `${number(20 * Math.log10(peak), 3)} dBFS` : "silence"}`;
    };
  };
}

/** Rows of bytes from the lowest frequency up as a picture: the ramp's colours, the frequency axis linear or not. */
function painted(image, ramp, y, height) {
  const { rows, hz } = image;
  const columns = rows[0].length;
  const canvas = new OffscreenCanvas(columns, height);
  const pen = canvas.getContext("2d");
  const picture = pen.createImageData(columns, height);
  const last = rows.length - 1;
  for (let line = 0; line < height; line++) {
    const frequency = y.invert(y.to + line + 0.5);
    const place = ((frequency - hz[0]) / (hz[last] - hz[0])) * last;
    const below = Math.max(0, Math.min(last, Math.floor(place)));
    const above = Math.min(last, below + 1);
    const share = Math.max(0, Math.min(1, place - below));
    for (let column = 0; column < columns; column++) {
      const value = rows[below][column] * (1 - share) + rows[above][column] * share;
      const colour = 3 * Math.round(value);
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
 * image {t_s: [centres], hz: [rows' frequencies, equally far apart], rows: [[0…255 per time]], low_db, high_db}.
 *
 * formant: {t_s, hz} (null where there is none), drawn over it; log: frequency axis; high_hz: its end; length_s of the
 * time axis; difference: the bytes are differences, low_db … high_db with 0 in the middle.
 */
export function spectrogram(image, { formant = null, log = false, high_hz = 10000, difference = false, length_s = null } = {}) {
  return (pen, box) => {
    const colours = theme();
    const ramp = difference ? differenceRamp(colours.dark) : levelRamp(colours.dark);
    const step = image.t_s.length > 1 ? image.t_s[1] - image.t_s[0] : 1;
    const [begin, end] = [Math.max(0, image.t_s[0] - step / 2), image.t_s.at(-1) + step / 2];
    const top = Math.min(high_hz, image.hz.at(-1));
    const plot = { ...box, right: box.right - SCALE };
    const x = linear(0, length_s ?? end, plot.left, plot.right);
    const y = log ? logarithmic(40, top, plot.bottom, plot.top) : linear(0, top, plot.bottom, plot.top);
    const height = Math.max(1, Math.round(plot.bottom - plot.top));
    pen.imageSmoothingEnabled = true;
    pen.imageSmoothingQuality = "high";
    const painting = painted(image, ramp, y, height);
    clipped(pen, plot, () => pen.drawImage(painting, x.at(begin), plot.top, x.at(end) - x.at(begin), plot.bottom - plot.top));
    axes(pen, plot, { x, y, xName: "s", yName: "Hz", lines: false, yFormat: (v) => (v >= 1000 ? `${short(v / 1000)}k` : short(v)) });
    levelScale(pen, box, ramp, image, difference ? "dB apart" : "dB");
    if (formant) {
      clipped(pen, plot, () => {
        for (const [width, colour] of [[4, colours.dark ? "rgb(0 0 0 / 65%)" : "rgb(255 255 255 / 75%)"], [1.75, colours.second]]) {
          pen.lineWidth = width;
          pen.strokeStyle = colour;
          pen.lineJoin = "round";
          polyline(pen, formant.t_s, formant.hz, x, y);
        }
      });
    }
    return (px, py) => {
      if (!inside(plot, px, py)) return null;
      const [t, frequency] = [x.invert(px), y.invert(py)];
      const column = Math.max(0, Math.min(image.t_s.length - 1, Math.round((t - image.t_s[0]) / step)));
      const row = Math.round(((frequency - image.hz[0]) / (image.hz.at(-1) - image.hz[0])) * (image.hz.length - 1));
      const level = image.low_db + ((image.rows[row]?.[column] ?? 0) / 255) * (image.high_db - image.low_db);
      return `${seconds(t)}, ${hertz(frequency)}: ${difference ? signed(level, 2) : number(level, 3)} dB`;
    };
  };
}

function levelScale(pen, box, ramp, { low_db, high_db }, unit) {
  const colours = theme();
  const left = box.right - SCALE + 12;
  const y = linear(low_db, high_db, box.bottom, box.top + 14);
  for (let line = Math.floor(y.to); line < y.from; line++) {
    pen.fillStyle = sample(ramp, (y.invert(line) - low_db) / (high_db - low_db));
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
  const reach = Math.max(2, ...shown.map((p) => 1.15 * Math.abs(p.cents)));
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
      return i === null ? null : `${shown[i].number}: ${number(shown[i].measured_hz, 6)} Hz, ${signed(shown[i].cents)} cents`;
    };
  };
}

/** The same partials' decay times, measured (dots) and of the model (line), over frequency. */
export function decays(partials, other = null) {
  const known = partials.filter((p) => p.model_t60_s > 0 || p.measured_t60_s > 0);
  const times = known.flatMap((p) => [p.model_t60_s, p.measured_t60_s]).filter((t) => t > 0);
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
    polyline(pen, known.map((p) => p.model_hz), known.map((p) => p.model_t60_s), x, y);
    for (const p of other ?? []) if (p.measured_t60_s > 0) dot(pen, x.at(p.measured_hz), y.at(p.measured_t60_s), 3, false);
    const places = known.map((p) => (p.measured_t60_s > 0 ? [x.at(p.measured_hz ?? p.model_hz), y.at(p.measured_t60_s)] : null));
    pen.fillStyle = colours.accent;
    known.forEach((p, i) => places[i] && dot(pen, ...places[i], size(p)));
    return (px, py) => {
      const i = nearest(places, px, py);
      if (i === null) return null;
      const p = known[i];
      return `${p.number}: ${seconds(p.measured_t60_s)}, model ${p.model_t60_s > 0 ? seconds(p.model_t60_s) : "–"}`;
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

/** contacts [{label, start_s, end_s, peak_n, impulse_ns}] in rows by label: when each point is touched, and how hard. */
export function contactTimeline(contacts, labels, length_s) {
  const hardest = Math.max(1e-9, ...contacts.map((c) => c.peak_n));
  return (pen, box) => {
    const colours = theme();
    const plot = { ...box, right: box.right - SCALE };
    const ramp = levelRamp(colours.dark);
    const x = linear(0, length_s, plot.left, plot.right);
    const row = (plot.bottom - plot.top) / Math.max(1, labels.length);
    const image = { low_db: 0, high_db: hardest };
    axes(pen, plot, { x, xName: length_s < 0.5 ? "ms" : "s", xFormat: length_s < 0.5 ? (v) => short(1000 * v) : short });
    pen.font = colours.font;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillStyle = colours.muted;
    const every = Math.ceil(13 / row);
    labels.forEach((label, i) => {
      if (i % every === 0) pen.fillText(label, plot.left - 7, plot.top + (i + 0.5) * row, plot.left - 4);
    });
    const loudness = (c) => 0.25 + 0.75 * Math.sqrt(c.peak_n / hardest);
    clipped(pen, plot, () => {
      for (const c of contacts) {
        const i = labels.indexOf(c.label);
        pen.fillStyle = sample(ramp, loudness(c));
        pen.fillRect(x.at(c.start_s), plot.top + i * row + 1, Math.max(1, x.at(c.end_s) - x.at(c.start_s)), Math.max(1, row - 2));
      }
    });
    forceScale(pen, box, ramp, image);
    return (px, py) => {
      if (!inside(plot, px, py)) return null;
      const label = labels[Math.floor((py - plot.top) / row)];
      const t = x.invert(px);
      const slack = 2 / ((plot.right - plot.left) / length_s);
      const hit = contacts.find((c) => c.label === label && t >= c.start_s - slack && t <= c.end_s + slack);
      return hit
        ? `${label} from ${seconds(hit.start_s)} for ${seconds(hit.end_s - hit.start_s)}: up to ${number(hit.peak_n, 3)} N`
        : `${label} at ${seconds(t)}: free`;
    };
  };
}

function forceScale(pen, box, ramp, { high_db: hardest }) {
  const colours = theme();
  const left = box.right - SCALE + 12;
  const y = linear(0, 1, box.bottom, box.top + 14);
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
 * Points and a fitted line: {points: [[x, y]], line: [[x, y]], xName, yName, log (both axes), say(x, y) for the reading}.
 * Points that the fit left aside, `aside`, are drawn hollow.
 */
export function fitted({ points, line, aside = [], xName, yName, log = false, say }) {
  return (pen, box) => {
    const colours = theme();
    const all = [...points, ...line, ...aside].filter(([, y]) => Number.isFinite(y) && (!log || y > 0));
    if (points.length === 0) return empty(pen, box, "No partial could be measured");
    const [xs, ys] = [all.map(([x]) => x), all.map(([, y]) => y)];
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const margin = 0.08 * (high - low) || 1;
    const x = log ? logarithmic(0.85 * left, 1.15 * right, box.left, box.right) : linear(0, right + 1, box.left, box.right);
    const y = log ? logarithmic(0.75 * low, 1.35 * high, box.bottom, box.top) : linear(low - margin, high + margin, box.bottom, box.top);
    const xFormat = log ? (v) => (v >= 1000 ? `${short(v / 1000)}k` : short(v)) : short;
    axes(pen, box, { x, y, xName, yName, xFormat });
    pen.strokeStyle = colours.second;
    pen.lineWidth = 1.75;
    clipped(pen, box, () => polyline(pen, line.map(([v]) => v), line.map(([, v]) => v), x, y));
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
