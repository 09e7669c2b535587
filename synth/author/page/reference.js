// The converged reference, run in the background: how far the present plan is from it.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h, noteName, number } from "./format.js";
import { Figure } from "./figure.js";
import { follow } from "./job.js";
import { spectrogram, waveform } from "./pictures.js";

const SECONDS = 1;

export function mount(element, { store, api }) {
  let job = null;
  let of = null;

  const start = h("button", { type: "button", id: "reference", onclick: run }, "Run the converged reference");
  const cancel = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => job?.cancel() }, "Cancel");
  const bar = h("progress", { max: 1, value: 0, hidden: true, "aria-label": "Reference" });
  const said = h("span", { class: "unit", role: "status" });
  const result = h("div", { class: "reference-result", hidden: true });
  const facts = h("dl", { class: "tiles" });
  const wave = new Figure("Output: filled as planned, outlined the reference", { height: 120 });
  const image = new Figure("Spectrogram: planned less reference", { height: 180 });
  result.append(facts, h("div", { class: "plots" }, wave.element, image.element));
  element.append(h("div", { class: "reference-head" }, start, bar, cancel, said), result);

  function busy(on) {
    start.disabled = on;
    cancel.hidden = bar.hidden = !on;
  }

  async function run() {
    const { doc, note, velocity } = store.state;
    busy(true);
    bar.removeAttribute("value");
    said.textContent = "";
    try {
      const { job: id } = await api.post(`/api/docs/${encodeURIComponent(doc.doc)}/reference`, { note, velocity, seconds: SECONDS });
      job = follow(api, id, (progress) => (bar.value = progress));
      const found = await job.result;
      of = { doc: doc.doc, revision: doc.revision, note, velocity };
      show(found);
    } catch (error) {
      said.textContent = error.message;
    } finally {
      job = null;
      busy(false);
    }
  }

  function show(found) {
    const items = [
      ["e", found.e, "Relative error of the string's displacement against the converged run, over the whole of it"],
      ["e, first 100 ms", found.e_100ms, "The same over the first 100 ms"],
      ["Log-spectral", found.log_spectral_db, "Log-spectral distance, dB", "dB"],
      ["Third octaves", found.third_octave_db, "Difference of levels in third octaves, dB", "dB"],
    ];
    facts.replaceChildren(
      ...items.map(([name, value, tip, unit]) =>
        h("div", { title: tip }, h("dt", {}, name), h("dd", {}, value === null ? "–" : `${number(value, 2)}${unit ? ` ${unit}` : ""}`)),
      ),
    );
    wave.show(waveform(found.waveform, found.reference_waveform));
    image.show(spectrogram(found.difference, { difference: true }));
    result.hidden = false;
    age();
  }

  /** Say when what is shown belongs to an earlier version or another note. */
  function age() {
    if (!of) return;
    const { doc, note, velocity } = store.state;
    const same = doc?.doc === of.doc && doc.revision === of.revision && note === of.note && velocity === of.velocity;
    result.classList.toggle("stale", !same);
    said.textContent = `${noteName(of.note)}, velocity ${of.velocity}, ${SECONDS} s${same ? "" : ": not what is shown above"}`;
    result.hidden = doc?.doc !== of.doc;
  }
  store.on(["doc", "note", "velocity"], age);
}
