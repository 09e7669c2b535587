// Pictures of strings that share a bridge: draw(pen, box) -> reading(x, y), as in pictures.js.

import { apart } from "./bridge.js";
import { axes, clipped, linear, polyline, seconds, theme } from "./figure.js";
import { noteName, number } from "./format.js";

const LOWEST_DB = -90;
const SPAN_DB = 60;
const OVER_DB = 3;
/** Room at the right for the names of strings. */
const NAMES = 58;
const LINE_PX = 12;
/** Longest stretch that an early or late decay is drawn for, as a share of what is shown. */
const EARLY_SHARE = 0.35;

/** decay {t_s, level_db, fitted_db, early_t60_s, late_t60_s}: envelope, the exponentials in it, both slopes. */
export function decayStages(decay) {
  const { t_s: times, level_db: measured, fitted_db: fitted, early_t60_s: early, late_t60_s: late } = decay;
  const top = Math.max(...measured) + OVER_DB;
  const bottom = Math.max(top - SPAN_DB, Math.min(...measured) - OVER_DB);
  return (pen, box) => {
    const colours = theme();
    const x = linear(0, times.at(-1), box.left, box.right);
    const y = linear(bottom, top, box.bottom, box.top);
    axes(pen, box, { x, y, xName: "s", yName: "dB" });
    clipped(pen, box, () => {
      pen.strokeStyle = colours.accent;
      pen.lineWidth = 2;
      polyline(pen, times, measured, x, y);
      pen.strokeStyle = colours.second;
      pen.lineWidth = 1;
      polyline(pen, times, fitted, x, y);
      pen.lineWidth = 1.5;
      pen.setLineDash([5, 4]);
      const span = times.at(-1) - times[0];
      // from where each begins to tell, at the level that is fitted there
      const first = [times[0], times[0] + EARLY_SHARE * span];
      const last = [times.at(-1) - EARLY_SHARE * span, times.at(-1)];
      polyline(pen, first, first.map((t) => fitted[0] - (60 * (t - first[0])) / early), x, y);
      polyline(pen, last, last.map((t) => fitted.at(-1) + (60 * (last[1] - t)) / late), x, y);
      pen.setLineDash([]);
    });
    return (px) => {
      const t = x.invert(px);
      if (t < times[0] || t > times.at(-1)) return null;
      const i = times.findIndex((one) => one >= t);
      return `${seconds(t)}: ${number(measured[i], 3)} dB`;
    };
  };
}

/** waking {bin_s, strings: [{string, opened, played, level_db}]}: the level of every string over the note. */
export function levels(waking, length_s) {
  const { bin_s: bin, strings } = waking;
  return (pen, whole) => {
    const colours = theme();
    const box = { ...whole, right: whole.right - NAMES };
    const x = linear(0, length_s, box.left, box.right);
    const y = linear(LOWEST_DB, OVER_DB, box.bottom, box.top);
    axes(pen, box, { x, y, xName: "s", yName: "dB" });
    clipped(pen, box, () => {
      for (const { played, level_db: db } of strings) {
        pen.strokeStyle = played ? colours.accent : colours.ink;
        pen.lineWidth = played ? 2 : 1;
        polyline(pen, db.map((_, i) => (i + 1) * bin), db, x, y);
      }
    });
    pen.font = colours.font;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    // names beside the ends of their lines, none over another; where there is no room for all, the played and the loudest
    const fitting = Math.max(1, Math.floor((box.bottom - box.top) / LINE_PX));
    const ends = strings.map((string) => ({ ...string, at: y.at(string.level_db.at(-1)) - box.top }));
    const named = ends.sort((a, b) => b.played - a.played || a.at - b.at).slice(0, fitting);
    const places = apart(named.map(({ at }) => at), LINE_PX, box.bottom - box.top);
    for (const [i, { string, played }] of named.entries()) {
      pen.fillStyle = played ? colours.accent : colours.muted;
      pen.fillText(string, box.right + 6, box.top + places[i]);
    }
    return (px, py) => {
      if (px < box.left || px > box.right) return null;
      const i = Math.min(strings[0].level_db.length - 1, Math.max(0, Math.round(x.invert(px) / bin) - 1));
      const nearest = strings.reduce((best, one) => (Math.abs(y.at(one.level_db[i]) - py) < Math.abs(y.at(best.level_db[i]) - py) ? one : best));
      return `${nearest.string} (${noteName(nearest.opened)}): ${number(nearest.level_db[i], 3)} dB after ${seconds((i + 1) * bin)}`;
    };
  };
}
