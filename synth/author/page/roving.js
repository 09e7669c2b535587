// One stop of Tab for many things (a roving tabindex): Tab goes from group to group, arrow keys go from one to the next.
//
//   toolbar(element)          buttons: left and right arrow, Home, End
//   groups(root, ".group")    in each group of the root, what is marked data-stop is one thing after the other: up and down
//                             arrow, Home, End from its first element; Page up and down also out of a field, to the same
//                             part of the next one; Tab goes on through the parts of the one that has the focus.
//                             Rows of a table (".row") are to their control as controls are to their group. Gives a function
//                             to call where something else than hidden or open has put things out of sight.
//   grid(element)             cells, marked data-row and data-column with where they lie: arrows to the next one that way,
//                             Home and End within a row. Gives a function to call when the cells are others.

const FOCUSABLE = "button, input, select, textarea, summary, a[href], [tabindex]";
/** What has its own way of choosing one of several, and keeps the others out of Tab's way itself. */
const LEFT_OUT = '[role="tab"][aria-selected="false"], [data-no-stop]';
const AHEAD = { ArrowDown: 1, ArrowUp: -1, PageDown: 1, PageUp: -1, Home: -Infinity, End: Infinity };

const seen = (element) => element.checkVisibility({ visibilityProperty: true });
const usable = (element) => seen(element) && !element.matches(":disabled");
const focusables = (element) => [...(element.matches(FOCUSABLE) ? [element] : []), ...element.querySelectorAll(FOCUSABLE)];
const first = (element) => focusables(element).find((each) => usable(each) && !each.matches(LEFT_OUT));

export function toolbar(element) {
  const buttons = () => [...element.querySelectorAll("button")].filter((each) => each.closest("[role=radiogroup], [role=menu]") === null);
  let current = null;
  // the bar as a whole may be out of sight for now
  const able = (each) => !each.matches(":disabled") && !element.contains(each.closest("[hidden]"));

  function apply() {
    const all = buttons();
    const live = all.filter(able);
    if (!live.includes(current)) current = live[0] ?? null;
    for (const each of all) each.tabIndex = each === current ? 0 : -1;
  }

  element.addEventListener("focusin", ({ target }) => {
    if (!buttons().includes(target)) return;
    current = target;
    apply();
  });
  element.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[event.key];
    const live = buttons().filter(able);
    const at = live.indexOf(event.target);
    if (step === undefined || at < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    live[Math.abs(step) === 1 ? (at + step + live.length) % live.length : step < 0 ? 0 : live.length - 1].focus();
  });
  new MutationObserver(apply).observe(element, { childList: true, subtree: true, attributes: true, attributeFilter: ["disabled", "hidden"] });
  apply();
}

export function groups(root, selector) {
  /** Of every group, and of every table in it, the one that has, or had last, the focus. */
  const current = new WeakMap();
  const items = (group) => [...group.querySelectorAll("[data-stop]")].filter((each) => each.closest(selector) === group && first(each));

  function apply() {
    for (const group of root.querySelectorAll(selector)) {
      const all = items(group);
      if (!all.includes(current.get(group))) current.set(group, all[0]);
      const chosen = current.get(group);
      for (const each of group.querySelectorAll(FOCUSABLE)) {
        if (each.closest(selector) !== group) continue;
        const row = each.closest(".row");
        const inRow = row === null || row === chosenRow(row.parentElement);
        const on = each.closest("[data-stop]") === chosen && inRow && !each.matches(LEFT_OUT);
        const wanted = on ? 0 : -1;
        if (each.tabIndex !== wanted) each.tabIndex = wanted;
      }
    }
  }

  function chosenRow(rows) {
    const now = current.get(rows);
    return now?.parentElement === rows ? now : rows.querySelector(".row");
  }

  root.addEventListener("focusin", ({ target }) => {
    const item = target.closest("[data-stop]");
    const row = target.closest(".row");
    if (row !== null) current.set(row.parentElement, row);
    if (item !== null) current.set(item.closest(selector), item);
    apply();
  });

  root.addEventListener("keydown", (event) => {
    const step = AHEAD[event.key];
    const item = event.target.closest("[data-stop]");
    if (step === undefined || item === null || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
    const paging = event.key.startsWith("Page");
    // arrows are a field's own, and so are a slider's and a text's pages
    if (paging ? event.target.matches("input[type=range], textarea") : event.target !== first(item)) return;
    const row = event.target.closest(".row");
    const all = row === null ? items(item.closest(selector)) : [...row.parentElement.children];
    let at = all.indexOf(row ?? item);
    let list = all;
    if (row !== null && !(at + step in all)) {
      list = items(item.closest(selector));
      at = list.indexOf(item);
    }
    const next = list[Math.max(0, Math.min(list.length - 1, at + step))];
    event.preventDefault();
    const part = event.target.dataset.part?.replace(/\d+$/, "");
    const same = paging && part && focusables(next).find((each) => usable(each) && each.dataset.part?.replace(/\d+$/, "") === part);
    (same || first(next)).focus();
    next.scrollIntoView({ block: "nearest" });
  });

  new MutationObserver(apply).observe(root, { childList: true, subtree: true, attributes: true, attributeFilter: ["hidden", "open", "aria-selected"] });
  apply();
  return apply;
}

export function grid(element) {
  const cells = () => [...element.querySelectorAll("[data-row][data-column]")];
  const row = (cell) => Number(cell.dataset.row);
  const column = (cell) => Number(cell.dataset.column);
  const inRow = (at) => cells().filter((each) => row(each) === at).sort((a, b) => column(a) - column(b));
  /** Of the cell that has, or had last, the focus. */
  let place = null;

  function apply() {
    const all = cells();
    const there = all.find((each) => each.dataset.row === place?.row && each.dataset.column === place.column) ?? all[0];
    for (const each of all) each.setAttribute("tabindex", each === there ? 0 : -1);
  }

  /** The next cell in a direction, the nearest in the next row; null: there is none. */
  function next(cell, key) {
    const own = inRow(row(cell));
    const along = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (along !== undefined) return own[own.indexOf(cell) + along] ?? null;
    if (key === "Home" || key === "End") return own.at(key === "Home" ? 0 : -1);
    const rows = [...new Set(cells().map(row))].sort((a, b) => a - b);
    const other = inRow(rows[rows.indexOf(row(cell)) + (key === "ArrowUp" ? -1 : 1)]);
    const aside = (each) => Math.abs(column(each) - column(cell));
    return other.reduce((best, each) => (best === null || aside(each) < aside(best) ? each : best), null);
  }

  element.addEventListener("focusin", ({ target }) => {
    const cell = target.closest("[data-row][data-column]");
    if (cell === null) return;
    place = { ...cell.dataset };
    apply();
  });
  element.addEventListener("keydown", (event) => {
    const cell = event.target.closest("[data-row][data-column]");
    if (cell === null || !["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"].includes(event.key)) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    next(cell, event.key)?.focus();
  });
  apply();
  return apply;
}
