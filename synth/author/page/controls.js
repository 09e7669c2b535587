// The controls: made from GET …/parameters, in groups, with a search field; strings and resonances as tables of their own;
// numbers that are not given folded away.

import { changesFor, listBeside, shownBeside } from "./edits.js";
import { makeField } from "./field.js";
import { h, valueAt } from "./format.js";
import { latest } from "./latest.js";
import { changesOf, firstOf, macrosOf, turned } from "./macros.js";
import { groups as roveGroups } from "./roving.js";
import { stringName } from "./wording.js";

const GROUPS = {
  first: "Main controls",
  setup: "Setup",
  string: "Strings",
  pluck: "Pluck, finer",
  damping: "Damping",
  output: "Level and body",
  mapping: "Keys and pressure",
  about: "About this preset",
};
/** Groups that a step at random may change, and the tables of the file that it then steps. */
const SHUFFLED = { setup: ["obstacle", "pluck", "output"], string: ["string"], pluck: ["pluck"], damping: ["damping"], output: ["output"] };
/** What stands first in its group. */
const ORDER = ["obstacle.kind", "obstacle.jiva_um", "string", "nut"];
/** Lists of tables, one of which is shown at a time. */
const TABS = ["string"];
const KEYS = "The up and down arrows move between controls, Tab enters one; Page Up and Page Down move between fields";
const REST_MS = 300;

export function mount(element, { store }) {
  const search = h("input", { type: "search", placeholder: "Find a control", "aria-label": "Find a control", id: "control-search" });
  const shuffle = h("button", { type: "button", id: "randomise" }, "Randomise");
  shuffle.title = "Change every number a little at random; one undo reverts all of it";
  const none = h("p", { class: "controls-none muted", hidden: true }, "No control matches.");
  const groups = h("fieldset", { class: "control-groups", "aria-label": "Settings", "aria-description": KEYS });
  const body = h("div", { class: "controls-body" }, groups, none);
  element.append(h("div", { class: "controls-head" }, search, shuffle), body);

  // what a player turns first is open, the rest folded
  const shut = new Set(Object.keys(GROUPS).filter((group) => group !== "first"));
  let macros = new Map();
  let parameters = [];
  let byPath = new Map();
  let fields = new Map();
  // groups' bodies and the panel of the string, each with what it folds away
  let places = [];
  const unfolded = new Set();
  let shape = "";
  let tab = 0;
  let form = "";
  let resting = 0;
  let told = {};
  // the string that was chosen by its tab, and the note that it was chosen at: of two with the same note, it stays
  let pinned = null;

  shuffle.addEventListener("click", () => store.randomise());
  search.addEventListener("input", filter);
  search.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    search.value = "";
    filter();
  });

  const context = {
    store,
    parameterOf: (path) => byPath.get(path),
    commit(path, value, merge) {
      const macro = macros.get(path);
      if (macro) return store.editMany(changesOf(macro, value ?? macro.default, store.state.doc.data, store.state.doc.saved, byPath), merge);
      return store.editMany(changesFor(byPath.get(path), value, store.state.doc.data, byPath), merge);
    },
    commitMany: (changes, merge = null) => store.editMany(changes, merge),
    refuse: (path, reason) => (reason === null ? store.clearError(path) : store.refuse(path, reason)),
  };

  // ---- building: again only where the set of controls changed, so that focus and sliders stay
  const shapeOf = (data) =>
    JSON.stringify([
      parameters.map(({ path, kind, choices, label }) => [path, kind, choices?.length, label]),
      firstOf(parameters, data),
      macrosOf(parameters, data).map(({ path, moves }) => [path, moves]),
      tab,
      data.string.map((one) => one.name),
    ]);

  function follow({ doc }) {
    if (doc === null) return;
    update();
    // a drag changes numbers only: what is suggested beside them may wait until it rests
    const now = JSON.stringify(store.data(), (_, value) => (typeof value === "number" ? 0 : value));
    clearTimeout(resting);
    resting = setTimeout(ask, now === form ? REST_MS : 0);
    form = now;
  }

  const ask = latest(async () => {
    let found;
    try {
      found = await store.view("parameters", { which: store.state.which });
    } catch (error) {
      store.notify(error.message, "error");
      return;
    }
    parameters = found;
    store.setParameters(found);
    byPath = new Map(found.map((parameter) => [parameter.path, parameter]));
    const now = shapeOf(store.data());
    if (now !== shape) {
      shape = now;
      build();
    } else {
      for (const field of fields.values()) {
        if (macros.has(field.parameter.path)) continue;
        const { label } = field.parameter;
        Object.assign(field.parameter, byPath.get(field.parameter.path), { label });
      }
    }
    update();
  });

  function build() {
    const data = store.data();
    const focus = element.contains(document.activeElement) ? document.activeElement : null;
    const kept = focus && [focus.closest("[data-path]")?.dataset.path, focus.dataset.part];
    const scroll = body.scrollTop;
    fields = new Map();
    places = [];
    tab = Math.min(tab, data.string.length - 1);
    groups.replaceChildren();
    const first = firstOf(parameters, data);
    const turns = macrosOf(parameters, data);
    macros = new Map(turns.map((macro) => [macro.path, macro]));
    for (const [group, title] of Object.entries(GROUPS)) {
      const there = parameters.filter((parameter) => (first.includes(parameter.path) ? "first" : parameter.group) === group);
      const mine = group === "first" ? [...first.map((path) => byPath.get(path)), ...turns] : there;
      if (mine.length > 0) groups.append(makeGroup(group, title, mine, data));
    }
    filter();
    element.dataset.shows = `${store.state.doc.doc} ${tab}`;
    body.scrollTop = scroll;
    if (kept?.[0]) {
      const part = kept[1] ? `[data-part="${kept[1]}"]` : "input, select, textarea, button";
      groups.querySelector(`[data-path="${kept[0]}"] ${part}`)?.focus({ preventScroll: true });
    }
  }

  function makeGroup(group, title, mine, data) {
    const summary = h("summary", { "data-stop": true, "data-tip-keys": KEYS }, h("h2", {}, title));
    const inside = h("div", { class: "group-body" });
    const details = h("details", { class: "group", "data-group": group, open: !shut.has(group) }, summary, inside);
    details.addEventListener("toggle", () => {
      if (search.value !== "") return;
      if (details.open) shut.delete(group);
      else shut.add(group);
    });
    if (group in SHUFFLED) {
      const one = h("button", { type: "button", class: "quiet small", "data-part": "shuffle", "data-stop": true }, "randomise");
      one.setAttribute("aria-label", `Randomise ${title}`);
      one.addEventListener("click", (event) => {
        event.preventDefault();
        store.randomise(SHUFFLED[group]);
      });
      summary.append(one);
    }
    const blocks = [];
    for (const parameter of group === "first" ? mine : ordered(mine)) {
      if (parameter.kind === "list" && parameter.item === "table") {
        const rows = valueAt(data, parameter.path) ?? [];
        blocks.push(TABS.includes(parameter.path) ? makeTabs(parameter, rows) : makeRows(parameter, rows));
      } else if (!parameters.some((list) => list.item === "table" && parameter.path.startsWith(`${list.path}.`))) {
        blocks.push(place(parameter, data));
      }
    }
    addFolding(inside, blocks, group);
    return details;
  }

  /** The strings themselves before what concerns all of them, and what shapes most before the rest. */
  function ordered(some) {
    const rank = ({ path }) => {
      const at = ORDER.findIndex((one) => path === one || path.startsWith(`${one}.`));
      return at < 0 ? ORDER.length : at;
    };
    return [...some].sort((a, b) => rank(a) - rank(b));
  }

  // ---- folding: numbers that are not given, behind one line at the end
  function addFolding(inside, blocks, name) {
    const count = h("summary", { "data-stop": true });
    const away = h("div", { class: "group-body" });
    const fold = h("details", { class: "unset-values", "data-fold": name, open: unfolded.has(name), hidden: true }, count, away);
    fold.addEventListener("toggle", () => {
      if (search.value !== "") return;
      if (fold.open) unfolded.add(name);
      else unfolded.delete(name);
    });
    inside.append(...blocks, fold);
    places.push({ inside, fold, away, count, blocks, name });
  }

  const isNumber = ({ kind, item }) => kind === "number" || kind === "anchored" || (kind === "list" && item === "number");
  const isUnset = (value) => value === null || value === undefined || (Array.isArray(value) && value.length === 0);

  /** Every control where it belongs; one that has the focus moves when it has lost it. */
  function arrange() {
    const data = store.data();
    for (const { inside, fold, away, count, blocks } of places) {
      for (const [i, block] of blocks.entries()) {
        const field = fields.get(block.dataset.path);
        if (field?.element !== block || block.contains(document.activeElement)) continue;
        const { parameter } = field;
        if (macros.has(parameter.path)) continue;
        const to = isNumber(parameter) && isUnset(valueAt(data, parameter.path)) && !field.refused() ? away : inside;
        if (block.parentElement === to) continue;
        const next = blocks.slice(i + 1).find((one) => one.parentElement === to);
        to.insertBefore(block, next ?? (to === inside ? fold : null));
      }
      const folded = [...away.children].filter((each) => !each.hidden).length;
      fold.hidden = folded === 0;
      count.textContent = `${folded} unset ${folded === 1 ? "value" : "values"}`;
    }
  }
  groups.addEventListener("focusout", () => setTimeout(() => store.state.doc !== null && arrange()));

  function place(parameter, data) {
    // a list that shows another's column has both names
    const other = byPath.get(listBeside(parameter.path));
    const label = other ? `${parameter.label}, ${other.label.toLowerCase()}` : parameter.label;
    const field = makeField({ ...parameter, label }, context);
    fields.set(parameter.path, field);
    if (shownBeside(parameter.path, data)) field.element.hidden = true;
    return field.element;
  }

  const own = (path) => parameters.filter((parameter) => parameter.table === path);

  /** Strings: one at a time, chosen by tabs. */
  function makeTabs(parameter, rows) {
    const { path } = parameter;
    const data = store.data();
    const panel = h("div", { role: "tabpanel", class: "tab-panel group-body", "aria-label": `String ${stringName(rows[tab], tab)}` });
    const tabs = rows.map((row, i) => {
      const button = h(
        "button",
        { type: "button", role: "tab", "aria-selected": String(i === tab), tabindex: i === tab ? 0 : -1, "data-tab": i },
        stringName(row, i),
      );
      button.addEventListener("click", () => lead(i));
      button.addEventListener("keydown", (event) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (step === undefined) return;
        event.preventDefault();
        lead((i + step + rows.length) % rows.length);
        groups.querySelector(`[data-tab="${tab}"]`).focus();
      });
      return button;
    });
    const add = h("button", { type: "button", class: "quiet small", "data-part": "add", "aria-label": "Add a string like the last" }, "+");
    add.addEventListener("click", () => {
      const index = rows.length;
      store.edit(`${path}.${index}`, parameter.new).then((done) => done && lead(index));
    });
    const away = h("button", { type: "button", class: "quiet small", "data-part": "away" }, "remove this string");
    away.hidden = rows.length < 2;
    away.addEventListener("click", () => store.edit(`${path}.${tab}`, null));
    addFolding(panel, own(`${path}.${tab}`).map((one) => place(one, data)), path);
    panel.append(h("div", { class: "row-tools", "data-stop": true }, away));
    const list = h("div", { class: "tab-list", role: "tablist", "aria-label": "Strings", "data-stop": true }, ...tabs, add);
    return h("div", { class: "tabs", "data-path": path }, list, panel);
  }

  /** A string chosen by hand leads the picture and the sound to its own note. */
  function lead(index) {
    const { doc, table } = store.state;
    const notes = store.data().string[index]?.notes;
    if (index !== table && Array.isArray(notes) && doc.notes.includes(notes[0])) store.setNote(notes[0]);
    pinned = { index, note: store.state.note };
    choose(index);
  }

  function choose(index) {
    tab = index;
    shape = shapeOf(store.data());
    build();
    update();
  }

  /** Resonances: all below each other. */
  function makeRows(parameter, rows) {
    const { path, label, tip } = parameter;
    const data = store.data();
    const add = h("button", { type: "button", class: "quiet small", "data-part": "add" }, "+ resonance");
    add.addEventListener("click", () => store.edit(`${path}.${rows.length}`, parameter.new));
    const cards = rows.map((row, i) => {
      const away = h("button", { type: "button", class: "icon", "data-part": `away ${i}`, "aria-label": `Remove resonance ${i + 1}` }, "×");
      away.addEventListener("click", () => store.edit(`${path}.${i}`, null));
      const title = h("div", { class: "card-head", "data-stop": true }, h("span", { class: "muted" }, `Resonance ${i + 1}`), away);
      const card = h("div", { class: "card" }, title);
      addFolding(card, own(`${path}.${i}`).map((one) => place(one, data)), `${path}.${i}`);
      return card;
    });
    const name = h("button", { type: "button", class: "control-name", "data-tip": tip, "data-tip-tap": true }, label);
    const head = h("div", { class: "control-head", "data-stop": true }, h("span", { class: "control-mark" }), name, h("span", { class: "control-entry" }, add));
    return h("div", { class: "table-list", "data-path": path }, head, ...cards);
  }

  // ---- values
  function update() {
    const { doc, errors, which } = store.state;
    if (doc === null) return;
    const data = store.data();
    groups.disabled = which === "saved";
    shuffle.disabled = which === "saved";
    for (const [path, field] of fields) {
      if (macros.has(path)) {
        const macro = macros.get(path);
        const error = which === "saved" ? undefined : macro.moves.map((moved) => errorOf(moved, errors)).find(Boolean);
        field.update(turned(macro, data, doc.saved), { saved: macro.default, error });
        continue;
      }
      field.update(valueAt(data, path) ?? null, {
        saved: which === "saved" ? (valueAt(data, path) ?? null) : (valueAt(doc.saved, path) ?? null),
        error: which === "saved" ? undefined : errorOf(path, errors),
      });
    }
    arrange();
    for (const group of groups.children) group.classList.toggle("has-changes", group.querySelector(".control.changed") !== null);
  }

  /** Why an edit of this field, or of a value in it, was refused. */
  function errorOf(path, errors) {
    return errors[path] ?? Object.entries(errors).find(([each]) => each.startsWith(`${path}.`))?.[1];
  }

  /** Reasons that have come and that no field shows are told as notices. */
  function tell({ errors }) {
    for (const [path, reason] of Object.entries(errors)) {
      const shown = [...fields.keys(), ...[...macros.values()].flatMap(({ moves }) => moves)].some((field) => path === field || path.startsWith(`${field}.`));
      if (!shown && told[path] !== reason) store.notify(`${store.labelOf(path)}: ${reason}`, "error");
    }
    told = errors;
  }

  function filter() {
    const words = search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    let any = false;
    for (const group of groups.children) {
      let here = false;
      for (const control of group.querySelectorAll(".control")) {
        const { path, label, tip } = fields.get(control.dataset.path).parameter;
        const text = `${label} ${path} ${group.dataset.group} ${tip}`.toLowerCase();
        const found = words.every((word) => text.includes(word));
        control.classList.toggle("filtered", !found);
        here ||= found && !control.hidden;
      }
      group.hidden = !here && words.length > 0;
      group.open = words.length > 0 ? here : !shut.has(group.dataset.group);
      any ||= here;
    }
    for (const { fold, away, name } of places) {
      fold.open = words.length > 0 ? away.querySelector(".control:not(.filtered):not([hidden])") !== null : unfolded.has(name);
    }
    none.hidden = any || words.length === 0;
    rove();
  }

  const rove = roveGroups(groups, ".group");
  store.on(["doc", "which"], follow);
  store.on(["errors"], (state) => {
    update();
    tell(state);
  });
  // the string that plays the note is the one that is shown
  store.on(["table"], ({ table, note, doc }) => {
    if (pinned !== null && pinned.note === note) return;
    if (doc !== null && parameters.length > 0 && table !== tab) choose(table);
    else tab = table;
  });
  store.on(["note"], ({ note }) => {
    if (pinned !== null && pinned.note !== note) pinned = null;
  });
}
