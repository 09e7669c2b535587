// The converged reference, run in the background: how far the present plan is from it.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h, noteName, number } from "./format.js";
import { Figure } from "./figure.js";
import { follow } from "./job.js";
import { curves, spectrogram } from "./pictures.js";

const LENGTHS = [0.5, 1, 3];
const MEASURES = [
  ["e", "e", "", "Relative error of the string's displacement against the converged run, over the whole time"],
  ["e_100ms", "e, first 100 ms", "", "The same over the first 100 ms"],
  ["log_spectral_db", "Log-spectral distance", " dB", "Root mean square distance of the sounds' spectra"],
  ["third_octave_db", "Third octaves", " dB", "Difference of the levels in third-octave bands"],
];

export function mount(element, { store, api }) {
  let job = null;
  let of = null;

  const start = h("button", { type: "button", id: "reference", onclick: run }, "Run the converged reference");
  const length = h(
    "select",
    { "aria-label": "Length of the reference" },
    ...LENGTHS.map((s) => h("option", { value: s, selected: s === 1 }, `${s} s`)),
  );
  const cancel = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => job?.cancel() }, "Cancel");
  const bar = h("progress", { max: 1, hidden: true, "aria-label": "Reference" });
  const said = h("span", { class: "unit", role: "status" });
  const result = h("div", { class: "reference-result", hidden: true });
  const tiles = h("dl", { class: "tiles" });
  const promise = h("p", { class: "muted promise" });
  const detail = new Figure("The first 50 ms after the release: planned, reference, difference", {
    height: 150,
    margins: { left: 58 },
  });
  const image = new Figure("Spectrogram: planned minus reference", { height: 200, margins: { left: 58 } });
  for (const figure of [detail, image]) figure.element.classList.add("wide");
  result.append(tiles, promise, h("div", { class: "plots" }, detail.element, image.element));
  element.append(h("div", { class: "reference-head" }, start, length, bar, cancel, said), result);

  function busy(on) {
    start.disabled = length.disabled = on;
    cancel.hidden = bar.hidden = !on;
  }

  async function run() {
    const { doc, note, velocity, which } = store.state;
    const seconds = Number(length.value);
    const about = { doc: doc.doc, revision: doc.revision, note, velocity, which, seconds };
    busy(true);
    bar.removeAttribute("value");
    said.textContent = "";
    try {
      const fields = { note, velocity, seconds, which };
      const posted = api.post(`/api/docs/${encodeURIComponent(doc.doc)}/reference`, fields);
      job = follow(api, posted, (progress) => (bar.value = progress));
      const found = await job.result;
      of = about;
      show(found);
    } catch (error) {
      said.textContent = error.message;
    } finally {
      job = null;
      busy(false);
    }
  }

  function show(found) {
    const { doubt, standard, reference } = found;
    const measured = MEASURES.map(([key, name, unit, tip]) => [
      name,
      found[key] === null ? "–" : number(found[key], 2) + unit,
      doubt?.[key] === null || doubt?.[key] === undefined ? "" : `± ${number(doubt[key], 2)}`,
      `${tip}; after ±: the difference of a run at half the reference's rate`,
    ]);
    const rates = [
      [
        "Planned",
        `${number(standard.rate_hz / 1000, 4)} kHz`,
        `in ${number(standard.seconds, 2)} s`,
        `${standard.modes} modes`,
      ],
      [
        "Reference",
        `${number(reference.rate_hz / 1000, 4)} kHz`,
        `in ${number(reference.seconds, 2)} s`,
        `${reference.modes} modes`,
      ],
    ];
    tiles.replaceChildren(
      ...[...measured, ...rates].map(([name, value, more, tip]) =>
        h("div", { title: tip }, h("dt", {}, name), h("dd", {}, value, more ? h("small", {}, ` ${more}`) : null)),
      ),
    );
    promise.textContent = `Promised: ${found.promise}`;
    const { start_s, step_s } = found.detail;
    detail.show(
      curves({
        start_s,
        step_s,
        lines: [
          { values: found.detail.reference, colour: "second", width: 4, name: "reference" },
          { values: found.detail.standard, colour: "ink", width: 1.25, name: "planned" },
          { values: found.detail.difference, colour: "accent", width: 1.25, name: "difference" },
        ],
      }),
    );
    const { span_db } = found.spectrogram_difference;
    image.show(
      spectrogram({ ...found.spectrogram_difference, floor_db: -span_db, top_db: span_db }, { difference: true, log: true }),
    );
    result.hidden = false;
    age();
  }

  /** Say when what is shown belongs to an earlier version or another note. */
  function age() {
    if (!of) return;
    const { doc, note, velocity, which } = store.state;
    const same =
      doc?.doc === of.doc &&
      doc.revision === of.revision &&
      note === of.note &&
      velocity === of.velocity &&
      which === of.which;
    result.classList.toggle("stale", !same);
    const about = `${noteName(of.note)}, velocity ${of.velocity}, ${of.seconds} s${of.which === "saved" ? ", as saved" : ""}`;
    said.textContent = same ? about : `${about}: an earlier result; the settings above have changed since`;
    result.hidden = doc?.doc !== of.doc;
  }
  store.on(["doc", "note", "velocity", "which"], age);
}
