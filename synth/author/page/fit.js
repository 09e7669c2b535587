// Fitting a string of the preset to a recording: drop a note, look at the fit against the data, take it over. Unless a string
// is chosen, it is the one whose note lies nearest. What is fitted is the string itself, or what it touches and the hand.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h, noteName, number, valueAt } from "./format.js";
import { Figure, hertz, seconds, signed } from "./figure.js";
import { follow } from "./job.js";
import { fitted } from "./pictures.js";
import { dropTarget } from "./sheets.js";

const MOST_BYTES = 100e6;
const AUDIO = /\.(wav|wave|flac|aif|aiff|ogg)$/i;

export function mount(element, { store, api }) {
  const dialog = element.closest("dialog");
  /** The fit under way: {abort, job: followed, once it is begun}; what has another one, or none, before it is over is let go. */
  let run = null;
  /** What is shown: {job, doc, report}. */
  let result = null;
  let last = null;
  let shownDoc = null;

  const NEAREST = "the string nearest to the note";
  const strings = h("select", { id: "fit-string", onchange: () => (run !== null || result !== null) && listen(last) });
  const again = () => {
    amplitudeLine.hidden = !contact();
    if (run !== null || result !== null) listen(last);
  };
  const kinds = h(
    "select",
    { id: "fit-kind", onchange: again },
    h("option", { value: "string" }, "String: pitch, losses, pluck"),
    h("option", { value: "contact" }, "Bridge and hand: height, place"),
  );
  const contact = () => kinds.value === "contact";
  const amplitude = h("input", {
    type: "number",
    id: "fit-amplitude",
    min: 0.01,
    max: 49,
    step: "any",
    placeholder: "as the preset",
    title: "How far the string was drawn aside, if you know it; otherwise the preset's hardest pluck is assumed",
    onchange: () => contact() && again(),
  });
  const amplitudeLine = h("label", { class: "fit-string", hidden: true }, h("span", {}, "Displacement, mm"), amplitude);
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
    h("button", { type: "button", class: "quiet", id: "cancel-fit", onclick: () => begin() }, "Cancel"),
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
    h(
      "div",
      { class: "fit-choices" },
      h("label", { class: "fit-string" }, h("span", {}, "Find"), kinds),
      h("label", { class: "fit-string" }, h("span", {}, "String"), strings),
      amplitudeLine,
    ),
    zone,
    working,
    refusal,
    found,
  );

  // ---- what the fit says
  const proposal = h("p", { class: "fit-proposal" });
  const tiles = h("dl", { class: "tiles" });
  const warnings = h("ul", { class: "warnings" });
  const stretch = new Figure("Frequency against number, above n f₀", { height: 170 });
  const decay = new Figure("T60 against frequency", { height: 170 });
  const levels = new Figure("Level at the onset against number", { height: 170 });
  const bands = new Figure("Level of each band over the note", { height: 220 });
  const settings = h("div", { class: "settings", tabindex: 0, role: "region", "aria-label": "Settings" });
  const apply = h("button", { type: "button", class: "primary", id: "apply-fit", onclick: take }, "Fill the controls");
  const aside = h("span", {}, h("i", { class: "key-dot hollow" }), " measured, but not fitted ");
  found.append(
    proposal,
    tiles,
    warnings,
    h("div", { class: "plots" }, stretch.element, decay.element, levels.element, bands.element),
    h(
      "p",
      { class: "unit" },
      h("i", { class: "key-dot" }),
      " measured ",
      aside,
      h("i", { class: "key-line" }),
      " fitted",
    ),
    h("h3", {}, "New values"),
    settings,
    h(
      "div",
      { class: "sheet-actions fit-actions" },
      h("button", { type: "button", onclick: () => begin() }, "Another recording"),
      apply,
    ),
  );

  /** Ready for a recording: what is under way is ended, what is shown is put away. */
  function begin() {
    if (run !== null) {
      run.abort.abort();
      run.job?.cancel();
      run = null;
    }
    result = null;
    for (const part of [working, refusal, found]) part.hidden = true;
    zone.hidden = false;
  }

  async function listen(file) {
    if (!store.state.doc) return;
    begin();
    last = file;
    if (file.size > MOST_BYTES)
      return refuse(file.name, `it has ${Math.round(file.size / 1e6)} MB; at most ${MOST_BYTES / 1e6} MB are accepted`);
    const can = contact() ? store.state.session?.fit_contact : store.state.session?.fit;
    if (can && !can.available) return refuse(file.name, can.reason);
    if (contact() && !amplitude.checkValidity())
      return refuse(file.name, "the displacement must be 0.01 to 49 mm; leave it empty to take the preset's");
    zone.hidden = true;
    working.hidden = false;
    working.firstChild.textContent = file.name;
    bar.removeAttribute("value");
    const mine = { abort: new AbortController(), job: null };
    run = mine;
    const { doc } = store.state.doc;
    try {
      const query = new URLSearchParams({
        doc,
        ...(strings.value === "" ? {} : { string: strings.value }),
        ...(contact() ? { contact: 1, ...(amplitude.value === "" ? {} : { amplitude: amplitude.value }) } : {}),
      });
      const posted = api.post(`/api/fit?${query}`, file, { signal: mine.abort.signal });
      mine.job = follow(api, posted, (progress) => mine === run && (bar.value = progress));
      const report = await mine.job.result;
      if (mine !== run) return;
      run = null;
      result = { job: await mine.job.id, doc, report };
      show(report);
    } catch (error) {
      if (mine !== run) return;
      run = null;
      begin();
      refuse(file.name, error.message === "Cancelled" ? "another fit of this preset was started elsewhere" : error.message);
    } finally {
      if (run === null) working.hidden = true;
    }
  }

  function refuse(name, reason) {
    refusal.replaceChildren(h("strong", {}, `${name} is not fitted`), h("p", {}, reason));
    refusal.hidden = false;
  }

  function show(report) {
    zone.hidden = true;
    found.hidden = false;
    propose(report);
    tiles.replaceChildren(
      ...report.facts.map(([name, value, tip]) => h("div", { title: tip }, h("dt", {}, name), h("dd", {}, value))),
    );
    warnings.replaceChildren(...report.warnings.map((words) => h("li", {}, words)));
    for (const figure of [stretch, decay, levels]) figure.element.hidden = "bands" in report.curves;
    bands.element.hidden = !("bands" in report.curves);
    aside.hidden = "bands" in report.curves;
    if ("bands" in report.curves) showBands(report.curves.bands);
    else showPartials(report.curves);
    showSettings();
    apply.focus({ preventScroll: true });
  }

  function showPartials(curves) {
    stretch.show(
      fitted({ ...curves.frequency, xName: "partial", yName: "cents", say: (n, c) => `${n}: ${signed(c)} cents` }),
    );
    decay.show(
      fitted({ ...curves.decay, log: true, xName: "Hz", yName: "T60, s", say: (f, t) => `${hertz(f)}: ${seconds(t)}` }),
    );
    levels.show(fitted({ ...curves.level, xName: "partial", yName: "dB", say: (n, db) => `${n}: ${number(db, 3)} dB` }));
  }

  function showBands(curve) {
    const say = (f, db) => `${hertz(f)}: ${number(db, 3)} dB`;
    bands.show(fitted({ ...curve, logX: true, xName: "Hz", yName: "dB", say }));
  }

  /** Which string this is taken for, which lies nearer, and what amplitude a height is for. */
  function propose(report) {
    which(report);
    if (report.contact) proposal.append(" ", report.contact);
  }

  function which({ string, nearest, note }) {
    const named = (index) => `string ${strings.options[index + 1].text}`;
    const what = note === null ? "this note" : `${note.replace("#", "♯")}`;
    if (string === nearest) return proposal.replaceChildren(`Nearest to ${what} is ${named(nearest)}.`);
    const other = h("button", { type: "button", id: "fit-nearest", onclick: () => ((strings.value = nearest), listen(last)) }, "Fit that one");
    proposal.replaceChildren(`Fitted as ${named(string)}; nearest to ${what} is ${named(nearest)}. `, other);
  }

  function showSettings() {
    settings.replaceChildren(
      h(
        "table",
        {},
        h("thead", {}, h("tr", {}, ...["", "now", "fitted"].map((name) => h("th", { scope: "col" }, name)))),
        h(
          "tbody",
          {},
          ...result.report.settings.map(({ path, label, unit, value }) => {
            const say = path.endsWith(".notes") ? noteWords : words;
            return h(
              "tr",
              { "data-path": path },
              h("th", { scope: "row", title: path }, unit ? `${label}, ${unit}` : label),
              h("td", {}, say(valueAt(store.state.doc.data, path))),
              h("td", {}, say(value)),
            );
          }),
        ),
      ),
    );
  }

  async function take() {
    apply.disabled = true;
    const state = await store.applyFit(result.job);
    apply.disabled = false;
    if (state?.refused) {
      refuse("The string", state.refused.message);
      refusal.scrollIntoView({ block: "nearest" });
    }
    if (!state || state.refused) return;
    dialog.close();
    begin();
    store.notify("The controls now hold the fitted values; undo reverts them");
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

  // a refusal goes with the dialog
  dialog.addEventListener("close", () => (refusal.hidden = true));

  // ---- the strings of the document
  store.on(["doc"], ({ doc }) => {
    if ((doc?.doc ?? null) !== shownDoc) {
      shownDoc = doc?.doc ?? null;
      begin();
    } else if (result !== null) showSettings();
    const names = (doc?.data.string ?? []).map((string, i) => `${i + 1}: ${string.name || noteWords(string.notes)}`);
    const chosen = run === null && result === null && !dialog.open ? "" : strings.value;
    if ([NEAREST, ...names].join("\n") !== [...strings.options].map((option) => option.text).join("\n"))
      strings.replaceChildren(h("option", { value: "" }, NEAREST), ...names.map((name, i) => h("option", { value: i }, name)));
    strings.value = chosen !== "" && Number(chosen) < names.length ? chosen : "";
  });
}

/** A value of the preset in a few words. */
function words(value) {
  if (value === null || value === undefined || value.length === 0) return "–";
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
