// A number that may be given at notes: one value with a slider, or a small table of notes and values with its curve.

import { numberInput } from "./entry.js";
import { h, noteName, parseNote, s } from "./format.js";

const WIDTH = 240;
const HEIGHT = 36;
/** A page as narrow as a phone: tables begin folded, and fold as a page becomes so. */
const NARROW = matchMedia("(max-width: 640px)");

NARROW.addEventListener("change", () => {
  if (!NARROW.matches) return;
  for (const table of document.querySelectorAll("details.anchors")) table.open &&= table.contains(document.activeElement);
});

/** `single` is the control of one value, shown while there is one. */
export function makeAnchors(parameter, { store, commit, refuse, labels }, single) {
  const { path, unit } = parameter;
  const split = h("button", { type: "button", class: "icon", "data-part": "split", "aria-label": `${parameter.label} by note` }, "♪");
  split.title = "By note: give values at several notes, interpolated in between";
  const join = h("button", { type: "button", class: "quiet small", "data-part": "join" }, "one value");
  const curve = s("svg", { class: "anchor-curve", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, "aria-hidden": "true", preserveAspectRatio: "none" });
  const rows = h("div", { class: "rows", role: "table", "aria-labelledby": labels["aria-labelledby"] });
  const add = h("button", { type: "button", class: "quiet small", "data-part": "add" }, "+ note");
  const count = h("summary");
  const table = h("details", { class: "anchors", hidden: true }, count, curve, rows, h("div", { class: "row-tools" }, add, join));
  const one = [...single.entry, ...single.below];
  let anchors = null;
  let drawn = "";

  const keyed = (points) => Object.fromEntries(points.map(([note, value]) => [noteName(note).replace("♯", "#"), value]));
  const points = () => Object.entries(anchors).map(([note, value]) => [Number(note), value]).sort((a, b) => a[0] - b[0]);
  const send = (list, merge = null) => commit(path, keyed(list), merge && `${merge} ${path}`);

  split.addEventListener("click", () => {
    const notes = store.state.doc.notes;
    const value = store.value(path) ?? parameter.suggested ?? parameter.default ?? parameter.minimum ?? 0;
    table.open = true;
    send([...new Set([notes[0], notes.at(-1)])].map((note) => [note, value]));
  });
  join.addEventListener("click", () => {
    const here = nearest(points(), store.state.note);
    commit(path, here, null);
  });
  add.addEventListener("click", () => {
    const list = points();
    const free = store.state.doc.notes.filter((note) => !list.some(([taken]) => taken === note));
    if (free.length === 0) return;
    const wanted = free.reduce((best, note) => (Math.abs(note - store.state.note) < Math.abs(best - store.state.note) ? note : best));
    send([...list, [wanted, nearest(list, wanted)]]);
  });

  function build() {
    const list = points();
    rows.replaceChildren(
      ...list.map(([note, value], i) => {
        const name = h("input", { type: "text", class: "row-note", value: noteName(note), "aria-label": "Note", "data-part": `note ${i}` });
        name.addEventListener("change", () => {
          const next = parseNote(name.value);
          if (next === null) refuse(path, `“${name.value}” is not a note; write one such as C3 or F♯2`);
          else send(list.map((point, j) => (j === i ? [next, point[1]] : point)));
        });
        const entry = numberInput({ ...parameter, optional: false }, {
          commit: (changed, merge, reason) => {
            if (changed === undefined) return refuse(path, reason && `${noteName(note)}: ${reason}`);
            return send(points().map((point, j) => (j === i ? [point[0], changed] : point)), merge);
          },
          attributes: { class: "row-number", "data-part": `value ${i}`, "aria-label": `${parameter.label} at ${noteName(note)}` },
        });
        entry.update(value, false);
        const away = h("button", { type: "button", class: "icon", "aria-label": `Remove ${noteName(note)}`, "data-part": `away ${i}` }, "×");
        away.disabled = list.length === 1;
        away.addEventListener("click", () => send(list.filter((_, j) => j !== i)));
        return h("div", { class: "row", role: "row" }, name, entry.input, h("span", { class: "unit" }, unit ?? ""), away);
      }),
    );
    count.textContent = `${list.length} ${list.length === 1 ? "note" : "notes"}, ${noteName(list[0][0])} to ${noteName(list.at(-1)[0])}`;
    drawCurve(list);
  }

  function drawCurve(list) {
    const values = list.map(([, value]) => value);
    const log = values.every((value) => value > 0);
    const bend = (value) => (log ? Math.log(value) : value);
    const low = bend(Math.min(...values));
    const span = bend(Math.max(...values)) - low || 1;
    const first = list[0][0];
    const width = list.at(-1)[0] - first || 1;
    const place = ([note, value]) => [4 + ((WIDTH - 8) * (note - first)) / width, HEIGHT - 4 - ((HEIGHT - 8) * (bend(value) - low)) / span];
    const places = list.map(place);
    curve.replaceChildren(s("polyline", { points: places.map((p) => p.map((x) => x.toFixed(1)).join(",")).join(" ") }));
  }

  return {
    entry: single.entry,
    below: [h("div", { class: "slider-row" }, ...single.below, split), table],
    update(value, invalid) {
      const many = value !== null && typeof value === "object";
      for (const element of one) element.hidden = many;
      split.hidden = many;
      table.hidden = !many;
      if (!many) {
        anchors = null;
        drawn = "";
        single.update(value, invalid);
        return;
      }
      anchors = value;
      const text = JSON.stringify(value);
      if (text === drawn) return;
      drawn = text;
      if (!table.dataset.seen) table.open = Object.keys(value).length <= 5 && !NARROW.matches;
      table.dataset.seen = "yes";
      const focus = rows.contains(document.activeElement) ? document.activeElement.dataset.part : null;
      build();
      if (focus !== null) rows.querySelector(`[data-part="${focus}"]`)?.focus();
    },
  };
}

/** The value at the anchor nearest to a note. */
function nearest(list, note) {
  return list.reduce((best, point) => (Math.abs(point[0] - note) < Math.abs(best[0] - note) ? point : best))[1];
}
