// Fitting a string of the preset to a recording: drop a note, look at the fit against the data, take it over.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h, noteName, number } from "./format.js";
import { Figure, hertz, seconds, signed } from "./figure.js";
import { follow } from "./job.js";
import { fitted } from "./pictures.js";
import { dropTarget } from "./sheets.js";

const MOST_BYTES = 100e6;
const AUDIO = /\.(wav|wave|flac|aif|aiff|ogg)$/i;

export function mount(element, { store, api }) {
  const dialog = element.closest("dialog");
  let job = null;
  let result = null;

  let last = null;

  const strings = h("select", { id: "fit-string", onchange: () => !found.hidden && listen(last) });
  const picker = h("input", {
    type: "file",
    id: "fit-file",
    accept: ".wav,.flac,audio/*",
    class: "hidden-text",
    onchange: () => {
      if (picker.files[0]) listen(picker.files[0]);
      picker.value = "";
    },
  });
  const zone = h(
    "div",
    { class: "drop" },
    h("p", {}, "Drop a recording of one plucked string here"),
    h("p", { class: "muted" }, "WAV or FLAC; one note, from before it is plucked until it has faded."),
    h("label", { class: "button", for: "fit-file", tabindex: 0, role: "button" }, "Choose a file…"),
    picker,
  );
  zone.querySelector("label").addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    picker.click();
  });
  const bar = h("progress", { max: 1, "aria-label": "Fit" });
  const working = h(
    "div",
    { class: "fit-working", hidden: true },
    h("span", { class: "fit-name" }),
    bar,
    h("button", { type: "button", class: "quiet", onclick: () => job?.cancel() }, "Cancel"),
  );
  const refusal = h("div", { class: "fit-refusal", role: "alert", hidden: true });
  const found = h("div", { class: "fit-found", hidden: true });
  element.append(
    h(
      "div",
      { class: "sheet-head fit-head" },
      h("h2", {}, "Fit to a recording"),
      h("button", { type: "button", class: "icon", "aria-label": "Close", onclick: () => dialog.close() }, "×"),
    ),
    h("label", { class: "fit-string" }, h("span", {}, "String"), strings),
    zone,
    working,
    refusal,
    found,
  );

  // ---- what the fit says
  const tiles = h("dl", { class: "tiles" });
  const warnings = h("ul", { class: "warnings" });
  const stretch = new Figure("Frequency against number, above n f₀", { height: 170 });
  const decay = new Figure("T60 against frequency", { height: 170 });
  const levels = new Figure("Level at the onset against number", { height: 170 });
  const settings = h("div", { class: "settings", tabindex: 0, role: "region", "aria-label": "Settings" });
  const apply = h("button", { type: "button", class: "primary", id: "apply-fit", onclick: take }, "Fill the controls");
  found.append(
    tiles,
    warnings,
    h("div", { class: "plots" }, stretch.element, decay.element, levels.element),
    h("p", { class: "unit" }, h("i", { class: "key-dot" }), " measured ", h("i", { class: "key-line" }), " fitted"),
    h("h3", {}, "What would be set"),
    settings,
    h(
      "div",
      { class: "sheet-actions" },
      h("button", { type: "button", onclick: () => begin() }, "Another recording"),
      apply,
    ),
  );

  function begin() {
    for (const part of [working, refusal, found]) part.hidden = true;
    zone.hidden = false;
  }

  async function listen(file) {
    if (!store.state.doc) return;
    begin();
    last = file;
    if (file.size > MOST_BYTES)
      return refuse(file.name, `it has ${Math.round(file.size / 1e6)} MB; at most ${MOST_BYTES / 1e6} MB are taken`);
    if (store.state.session?.fit && !store.state.session.fit.available)
      return refuse(file.name, store.state.session.fit.reason);
    zone.hidden = true;
    working.hidden = false;
    working.firstChild.textContent = file.name;
    bar.removeAttribute("value");
    const { doc } = store.state.doc;
    try {
      const query = new URLSearchParams({ doc, string: strings.value });
      const { job: id } = await api.post(`/api/fit?${query}`, file);
      job = follow(api, id, (progress) => (bar.value = progress));
      const report = await job.result;
      result = { job: id, doc };
      show(report);
    } catch (error) {
      begin();
      if (error.message !== "Cancelled") refuse(file.name, error.message);
    } finally {
      job = null;
      working.hidden = true;
    }
  }

  function refuse(name, reason) {
    refusal.replaceChildren(h("strong", {}, `${name} is not fitted`), h("p", {}, reason));
    refusal.hidden = false;
    zone.hidden = false;
  }

  function show(report) {
    zone.hidden = true;
    found.hidden = false;
    tiles.replaceChildren(
      ...report.facts.map(([name, value, tip]) => h("div", { title: tip }, h("dt", {}, name), h("dd", {}, value))),
    );
    warnings.replaceChildren(...report.warnings.map((words) => h("li", {}, words)));
    const { curves } = report;
    stretch.show(
      fitted({ ...curves.frequency, xName: "partial", yName: "cents", say: (n, c) => `${n}: ${signed(c)} cents` }),
    );
    decay.show(
      fitted({ ...curves.decay, log: true, xName: "Hz", yName: "T60, s", say: (f, t) => `${hertz(f)}: ${seconds(t)}` }),
    );
    levels.show(fitted({ ...curves.level, xName: "partial", yName: "dB", say: (n, db) => `${n}: ${number(db, 3)} dB` }));
    settings.replaceChildren(
      h(
        "table",
        {},
        h("thead", {}, h("tr", {}, ...["", "now", "fitted"].map((name) => h("th", { scope: "col" }, name)))),
        h(
          "tbody",
          {},
          ...report.settings.map(({ path, value }) => {
            const say = path.endsWith(".notes") ? noteWords : words;
            return h(
              "tr",
              {},
              h("th", { scope: "row" }, path),
              h("td", {}, say(store.value(path))),
              h("td", {}, say(value)),
            );
          }),
        ),
      ),
    );
    apply.focus();
  }

  async function take() {
    if (result.doc !== store.state.doc?.doc) return;
    const state = await store.applyFit(result.job);
    if (state?.refused) return refuse("The fit", state.refused.message);
    if (!state) return;
    dialog.close();
    begin();
    store.notify("The controls are filled with the fit; undo takes it back");
  }

  // ---- where recordings come from: the zone, the whole page, the button
  zone.addEventListener("dragover", (event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
  for (const type of ["dragleave", "drop"]) zone.addEventListener(type, () => zone.classList.remove("over"));
  dropTarget(
    (file) => AUDIO.test(file.name),
    (file) => {
      if (!store.state.doc) return;
      if (!dialog.open) dialog.showModal();
      listen(file);
    },
  );

  store.on(["doc"], ({ doc }) => {
    const names = (doc?.data.string ?? []).map((string, i) => `${i + 1}: ${string.name || string.notes}`);
    if (names.join() === [...strings.options].map((option) => option.text).join()) return;
    strings.replaceChildren(...names.map((name, i) => h("option", { value: i }, name)));
  });
}

/** A value of the preset in a few words. */
function words(value) {
  if (value === null || value === undefined) return "–";
  if (Array.isArray(value))
    return value.length > 2
      ? `${value.length} values from ${words(value[0])} to ${words(value.at(-1))}`
      : value.map(words).join(" – ");
  if (typeof value === "object")
    return Object.entries(value)
      .map(([note, v]) => `${note} ${words(v)}`)
      .join(", ");
  return typeof value === "number" ? number(value, 5) : String(value);
}

/** The notes of a string, [lowest, highest] or as they are written. */
function noteWords(value) {
  if (!Array.isArray(value)) return words(value);
  return [...new Set(value)].map((note) => (typeof note === "number" ? noteName(note) : note)).join("–");
}
