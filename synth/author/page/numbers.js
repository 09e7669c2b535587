// A list of numbers as a small table: heights of frets, points under the string, measured partials.

import { listBeside } from "./edits.js";
import { numberInput } from "./entry.js";
import { h } from "./format.js";

export function makeNumbers(parameter, { store, parameterOf, commit, commitMany, refuse, labels }) {
  const { path } = parameter;
  const other = listBeside(path);
  const columns = other === null ? [parameter] : [parameter, parameterOf(other)];
  const count = h("summary");
  const rows = h("div", { class: "rows", role: "table", "aria-labelledby": labels["aria-labelledby"] });
  const add = h("button", { type: "button", class: "quiet small", "data-part": "add" }, "+ row");
  const table = h("details", { class: "anchors" }, count, rows, h("div", { class: "row-tools" }, add));
  let drawn = "";

  const lists = () => columns.map((column) => [...(store.value(column.path) ?? [])]);
  function send(next, merge = null) {
    if (columns.length === 1) return commit(path, next[0], merge);
    return commitMany(columns.map((column, c) => ({ path: column.path, value: next[c] })), merge);
  }

  add.addEventListener("click", () => {
    // an empty list may begin as what sounds like it now: the heights of a neck's frets
    const now = lists();
    if (now[0].length === 0 && Array.isArray(parameter.suggested)) send([parameter.suggested]);
    else send(now.map((list, c) => [...list, next(list, columns[c])]));
  });

  function build(now) {
    rows.replaceChildren(
      ...now[0].map((_, i) => {
        const cells = columns.flatMap((column, c) => {
          const name = `${column.label} ${i + 1}`;
          const entry = numberInput(
            { ...column, minimum: null, maximum: null, optional: false },
            {
              commit(value, merge, reason) {
                if (value === undefined) return refuse(path, reason && `row ${i + 1}: ${reason}`);
                return send(lists().map((list, k) => (k === c ? list.with(i, value) : list)), merge && `${merge} ${path}`);
              },
              attributes: { class: "row-number", "data-part": `value ${c} ${i}`, "aria-label": name },
            },
          );
          entry.update(now[c][i], false);
          return [entry.input, h("span", { class: "unit" }, column.unit)];
        });
        const away = h("button", { type: "button", class: "icon", "aria-label": `Remove row ${i + 1}`, "data-part": `away ${i}` }, "×");
        away.addEventListener("click", () => send(lists().map((list) => list.toSpliced(i, 1))));
        return h("div", { class: "row", role: "row" }, h("span", { class: "row-index muted" }, String(i + 1)), ...cells, away);
      }),
    );
    count.textContent = now[0].length === 0 ? "none" : `${now[0].length} ${now[0].length === 1 ? "row" : "rows"}`;
  }

  return {
    entry: [],
    below: [table],
    update() {
      const now = lists();
      const text = JSON.stringify(now);
      if (text === drawn) return;
      drawn = text;
      const focus = rows.contains(document.activeElement) ? document.activeElement.dataset.part : null;
      build(now);
      if (focus !== null) rows.querySelector(`[data-part="${focus}"]`)?.focus();
    },
  };
}

/** A new row's value: a place a little on, the next partial, else as the last. */
function next(list, { path }) {
  const last = list.at(-1) ?? (path.endsWith("heights_mm") ? -1 : 100);
  if (path.endsWith("positions_mm")) return Number((1.02 * last).toPrecision(4));
  if (path.endsWith("frequencies_hz")) return Number(((last * (list.length + 1)) / Math.max(1, list.length)).toPrecision(5));
  return last;
}
