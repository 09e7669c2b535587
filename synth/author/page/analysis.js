// What the note is made of: waveform, spectrogram, partials, contacts; what it costs, and how far it is from converged.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h, noteName, number } from "./format.js";
import { Figure, hertz, recolour, seconds, signed } from "./figure.js";
import { contactTimeline, decays, deviations, empty, spectrogram, waveform } from "./pictures.js";
import { decayStages, levels } from "./together.js";
import { mount as mountPlan } from "./plan.js";
import { mount as mountReference } from "./reference.js";

const WAIT_MS = 200;
const LENGTHS = [0.5, 1, 3, 6, 10];
const RANGES_DB = [50, 70, 90];
const CLOSER_S = 0.1;
/** Contacts are shown until the last one and this much longer. */
const AFTER = 1.15;
const SHORTEST_S = 0.02;
/** A decay of which less than 10 dB is heard is not sure. */
const SURE_LENGTHS = 6;
// one time axis below the other
const WIDE = { left: 58 };
const DIFFERENCE_DB = 30;
/** From which ratio of late to early on a decay has two stages. */
const TWO_STAGES = 1.15;

export function mount(element, { store, api }) {
  let lengthS = 3;
  let log = true;
  let rangeDb = 70;
  let compare = false;
  let stretch = "touched";
  let shown = null;
  let other = null;
  let timer = 0;
  let request = null;

  // ---- head
  const caption = h("span", { class: "muted" });
  const status = h("span", { class: "unit", role: "status" });
  const length = h(
    "select",
    { "aria-label": "Length", onchange: () => ((lengthS = Number(length.value)), ask()) },
    ...LENGTHS.map((value) => h("option", { value, selected: value === lengthS }, `${value} s`)),
  );
  const comparing = h("input", { type: "checkbox", onchange: () => ((compare = comparing.checked), ask()) });
  const head = h(
    "div",
    { class: "analysis-head" },
    h("h2", {}, "Analysis"),
    caption,
    status,
    h("span", { class: "spacer" }),
    h(
      "label",
      { class: "check", title: "Draws the other version as outlines and rings, and the difference between the two spectrograms" },
      comparing,
      "compare with the other version",
    ),
    length,
  );

  // ---- figures
  const wave = new Figure("Waveform", { height: 110, margins: WIDE });
  const peak = h("span", { class: "plot-peak" });
  wave.tools.append(peak);
  const spectrum = new Figure("Spectrogram", { height: 260, margins: WIDE });
  const logBox = h("input", { type: "checkbox", checked: true, onchange: () => ((log = logBox.checked), draw()) });
  const range = h(
    "select",
    { "aria-label": "Level range shown", onchange: () => ((rangeDb = Number(range.value)), draw()) },
    ...RANGES_DB.map((db) => h("option", { value: db, selected: db === rangeDb }, `${db} dB`)),
  );
  spectrum.tools.append(range, h("label", { class: "check" }, logBox, "log"));
  const cents = new Figure("Partials against number", { height: 180 });
  const decay = new Figure("Decay of partials against frequency", { height: 180 });
  const contacts = new Figure("Contacts", { height: 160, margins: WIDE });
  const stretches = h(
    "select",
    { "aria-label": "Time span shown", onchange: () => ((stretch = stretches.value), draw()) },
    h("option", { value: "touched" }, "to the last contact"),
    h("option", { value: "closer" }, `first ${seconds(CLOSER_S)}`),
    h("option", { value: "whole" }, "whole note"),
  );
  contacts.tools.append(stretches);
  for (const figure of [cents, decay]) {
    figure.tools.append(h("i", { class: "key-dot" }), " measured", h("i", { class: "key-line" }), " model");
  }
  const doubt = h("span", { hidden: true, title: "Less than 10 dB of its decay falls within this length" }, "○ not sure");
  decay.tools.append(doubt);
  const stages = new Figure("Decay of a partial over time", { height: 180 });
  const waking = new Figure("Strings that ring with it", { height: 180, margins: WIDE });
  const partial = h("select", { "aria-label": "Partial", id: "decay-partial", onchange: () => draw() });
  const stageWords = h("span", { id: "decay-words" });
  stages.tools.append(stageWords, partial);
  const table = h("div", { class: "partials", tabindex: 0, role: "region", "aria-label": "Table of partials" });
  const cost = h("dl", { class: "tiles" });
  const verdict = h("p", { class: "verdict" });
  const promise = h("p", { class: "muted promise" });
  const plan = h("div", { class: "reference" });
  const reference = h("div", { class: "reference" });
  element.append(
    head,
    h("div", { class: "plots" }, wave.element, spectrum.element, contacts.element, waking.element, cents.element, decay.element, stages.element),
    h("details", { class: "fold" }, h("summary", {}, "Table of partials"), table),
    h("section", { class: "cost", "aria-label": "Cost and error" }, h("h2", {}, "Cost and error"), verdict, cost, promise, plan, reference),
  );
  for (const figure of [wave, spectrum, contacts, waking, stages]) figure.element.classList.add("wide");
  for (const figure of [wave, spectrum, cents, decay, contacts, waking, stages]) figure.show((pen, box) => empty(pen, box, "…"));
  mountPlan(plan, { store, api });
  mountReference(reference, { store, api });

  // ---- asking: after the last change of a drag, the newest question only
  function ask() {
    clearTimeout(timer);
    timer = setTimeout(look, WAIT_MS);
  }

  async function look() {
    request?.abort();
    const { doc, note, velocity, which } = store.state;
    if (!doc || !doc.notes.includes(note)) return;
    const mine = (request = new AbortController());
    const chosen = { note, velocity, which };
    status.textContent = store.state.kernels === "loading" ? "waiting for the string engine…" : "computing…";
    element.setAttribute("aria-busy", "true");
    const get = (view, query) => store.view(view, query, { signal: mine.signal });
    const opposite = which === "current" ? "saved" : "current";
    let missing = "";
    try {
      const whole = { ...chosen, seconds: lengthS };
      const [analysis, second] = await Promise.all([
        get("analysis", whole),
        compare
          ? get("analysis", { ...whole, which: opposite }).catch((error) => {
              if (error.name === "AbortError") throw error;
              const version = opposite === "saved" ? "saved" : "edited";
              missing = `no comparison with the ${version} version: ${error.message}`;
              return null;
            })
          : null,
      ]);
      shown = analysis;
      other = second;
      caption.textContent = `${noteName(note)}, velocity ${velocity}${which === "saved" ? ", as saved" : ""}`;
      status.textContent = missing;
      draw();
      element.dispatchEvent(new CustomEvent("drawn", { detail: { revision: doc.revision, note } }));
      facts(await get("cost", chosen));
    } catch (error) {
      if (error.name !== "AbortError") status.textContent = error.message;
    } finally {
      if (request === mine) element.removeAttribute("aria-busy");
    }
  }

  // ---- drawing
  function draw() {
    if (!shown) return;
    const { partials } = shown;
    peak.textContent = `peak ${number(shown.peak_dbfs, 3)} dBFS`;
    wave.show(
      waveform(shown.waveform, other?.waveform, lengthS),
      `Waveform over ${lengthS} s, peak ${number(shown.peak_dbfs, 3)} dBFS`,
    );
    spectrum.show(
      other
        ? spectrogram(apart(shown.spectrogram, other.spectrogram), { log, difference: true, length_s: lengthS })
        : spectrogram(shown.spectrogram, { log, formant: shown.formant, length_s: lengthS, range_db: rangeDb }),
      describeFormant(shown.formant),
    );
    cents.show(deviations(partials, other?.partials), `Deviation of ${partials.length} partials from the model, in cents`);
    const longest_s = SURE_LENGTHS * lengthS;
    doubt.hidden = !partials.some((p) => p.measured_t60_s > longest_s);
    decay.show(decays(partials, other?.partials, longest_s), `Decay times of ${partials.length} partials, measured and of the model`);
    const { points, bin_s } = shown.timeline;
    contacts.setHeight(Math.max(116, 40 + Math.min(20, points.length) * (points.length > 8 ? 10 : 18)));
    const end_s = stretchShown(points);
    // single contacts where each is known or they are few enough
    const single = end_s <= CLOSER_S || shown.contacts.length === points.reduce((sum, p) => sum + p.contacts, 0);
    contacts.show(
      points.length
        ? contactTimeline(points, single ? touches(shown) : bins(shown.timeline), end_s, single ? 0 : bin_s)
        : (pen, box) => empty(pen, box, "The string touches nothing"),
      points.map((p) => `${p.label}: ${p.contacts} contacts, up to ${number(p.peak_n, 3)} N`).join("; ") || "No contacts",
    );
    table.replaceChildren(partialsTable(partials, shown.decays));
    drawTogether();
  }

  /** Of strings that share a bridge: how one partial decays and beats, and which strings ring along. */
  function drawTogether() {
    const { decays: found, waking: ringing } = shown;
    waking.element.hidden = ringing === null;
    stages.element.hidden = found.length === 0;
    if (ringing !== null) {
      const loud = ringing.strings.map(({ string, level_db: db }) => `${string} up to ${number(Math.max(...db), 2)} dB`);
      waking.show(levels(ringing, lengthS), `Levels of the strings: ${loud.join(", ")}`);
    }
    if (found.length === 0) return;
    const names = found.map(({ number: j }) => `Partial ${j}`);
    if ([...partial.options].map(({ text }) => text).join() !== names.join()) {
      const kept = partial.value;
      partial.replaceChildren(...found.map(({ number: j }, i) => h("option", { value: j }, names[i])));
      partial.value = found.some(({ number: j }) => String(j) === kept) ? kept : found[0].number;
    }
    const one = found.find(({ number: j }) => String(j) === partial.value) ?? found[0];
    stageWords.textContent = stagesInWords(one);
    stages.show(decayStages(one), `Partial ${one.number}: ${stagesInWords(one)}`);
  }

  /** How much of the note the contacts are shown for, in s. */
  function stretchShown(points) {
    const last_s = Math.max(0, ...points.map((p) => p.last_s));
    const until = { whole: lengthS, closer: CLOSER_S, touched: Math.max(SHORTEST_S, AFTER * last_s) };
    return Math.min(lengthS, until[stretch]);
  }

  function describeFormant(formant) {
    if (!formant || formant.length < 2) return "Spectrogram";
    return `Spectrogram; the buzz's formant goes from ${hertz(formant[0].hz)} to ${hertz(formant.at(-1).hz)}`;
  }

  function partialsTable(partials, staged) {
    const together = staged.length > 0;
    const of = new Map(staged.map((one) => [one.number, one]));
    const row = (p) =>
      h(
        "tr",
        {},
        h("th", { scope: "row" }, String(p.number)),
        ...[
          number(p.model_hz, 6),
          number(p.measured_hz, 6),
          p.cents === null ? "–" : signed(p.cents, 3),
          number(p.model_t60_s, 3),
          number(p.measured_t60_s, 3),
          number(p.level_db, 3),
          ...(together ? ["early_t60_s", "late_t60_s", "beat_hz"].map((key) => number(of.get(p.number)?.[key], 3)) : []),
        ].map((text) => h("td", {}, text)),
      );
    const names = ["", "model, Hz", "measured, Hz", "cents", "model T60, s", "measured T60, s", "level, dB"];
    if (together) names.push("early T60, s", "late T60, s", "beats, Hz");
    return h(
      "table",
      {},
      h("thead", {}, h("tr", {}, ...names.map((name) => h("th", { scope: "col" }, name)))),
      h("tbody", {}, ...partials.map(row)),
    );
  }

  function facts(found) {
    const { error } = found;
    const share = number(100 * found.load, 2);
    const items = [
      [
        "Speed",
        `${number(found.real_time_factor, 3)} ×`,
        "real time",
        found.together
          ? "How many times faster than real time one core of this machine computes the instrument with this note"
          : "How many times faster than real time one core of this machine computes one such string",
      ],
      [
        "All strings",
        `${share} %`,
        "of a core",
        found.together ? "Strings that share a bridge all move" : `${found.polyphony} strings like this at once, the preset's polyphony`,
      ],
      [
        "Steps",
        `${number(found.rate_hz / 1000, 4)} kHz`,
        "",
        "Internal rate: how many times per second the string's motion is solved",
      ],
      ["Modes", String(found.modes), "", "Number of vibration modes computed"],
      ["Contacts", String(found.contacts), "", "Number of points that the string can touch"],
      [
        "Error e",
        number(error.e, 2),
        `over ${number(error.over_s, 2)} s`,
        "Relative error of the string's displacement against a converged run",
      ],
      [
        "Spectrum",
        error.log_spectral_db === null ? "–" : `${number(error.log_spectral_db, 2)} dB`,
        "apart",
        "Log-spectral distance of the sound from that of a converged run",
      ],
    ];
    cost.replaceChildren(
      ...items.map(([name, value, more, tip]) =>
        h("div", { title: tip }, h("dt", {}, name), h("dd", {}, value, more ? h("small", {}, ` ${more}`) : null)),
      ),
    );
    verdict.textContent = `${speedInWords(found)} ${found.together ? "Run the reference to see how far it is from converged." : errorInWords(error)}`;
    promise.textContent = `${found.quality}: ${found.reason}`;
  }

  store.on(["doc", "note", "velocity", "which", "kernels"], ask);
  store.on(["theme"], () => recolour());
}

/** A partial's decay rates, one where both are alike, and its beats. */
function stagesInWords({ early_t60_s: early, late_t60_s: late, beat_hz: hz, beat_db: db }) {
  const times = late > TWO_STAGES * early ? `T60 ${seconds(early)} early, ${seconds(late)} late` : `T60 ${seconds(early)}`;
  return hz === null ? times : `${times}, beats ${number(hz, 3)} Hz, ${number(db, 2)} dB deep`;
}

function speedInWords({ load, polyphony, together }) {
  const all = together ? "all that share the bridge" : polyphony === 1 ? "its string" : `all ${polyphony} strings at once`;
  if (load < 0.5) return `Plays live with room to spare: ${all} take ${number(100 * load, 2)} % of a core.`;
  if (load < 1) return `Plays live, but close to the limit of a core with ${all}.`;
  return `Too heavy for one core with ${all}: use more cores, fewer strings or a lower quality.`;
}

function errorInWords({ e, log_spectral_db }) {
  if (log_spectral_db !== null && log_spectral_db < 1) return "Its spectrum is within 1 dB of a converged calculation's.";
  if (e !== null && e < 0.01) return "The motion is within 1 % of a converged calculation.";
  if (e !== null && e < 0.1) return "The motion is within 10 % of a converged calculation.";
  return "It differs from a converged calculation; the promised limits are listed below.";
}

/** Stretches of time in which points were touched, with the largest force of each. */
function bins({ bin_s, points, peak_n }) {
  return points.flatMap((_, row) =>
    peak_n[row].flatMap((peak, i) => (peak > 0 ? [{ row, start_s: i * bin_s, end_s: (i + 1) * bin_s, peak_n: peak }] : [])),
  );
}

/** Every single contact, in the rows of the timeline. */
function touches({ contacts, timeline }) {
  const rows = new Map(timeline.points.map(({ point }, row) => [point, row]));
  return contacts.map((contact) => ({ ...contact, row: rows.get(contact.point) }));
}

/** Two spectrograms' difference, in bytes about 0 dB in the middle. */
function apart(one, two) {
  const scale = (one.top_db - one.floor_db) / 255;
  const rows = one.rows.map((row, i) =>
    row.map((value, j) => {
      const db = (value - (two.rows[i]?.[j] ?? 0)) * scale;
      return Math.round(127.5 + (127.5 * Math.max(-DIFFERENCE_DB, Math.min(DIFFERENCE_DB, db))) / DIFFERENCE_DB);
    }),
  );
  return { ...one, rows, floor_db: -DIFFERENCE_DB, top_db: DIFFERENCE_DB };
}
