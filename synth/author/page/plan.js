// What each quality takes on the strings of the open preset, measured in the background and kept beside its file.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { h } from "./format.js";
import { follow } from "./job.js";

/** Obstacles over which a string is measured; those of strings on a shared body, and soft ones, are not. */
const MEASURED = ["bridge", "points", "frets"];

export function mount(element, { store, api }) {
  let job = null;

  const start = h(
    "button",
    {
      type: "button",
      id: "measure-plan",
      title: "Finds the lowest internal rate and fewest modes that keep each quality's promise, by playing every note; this takes minutes",
      onclick: run,
    },
    "Measure a plan for these strings",
  );
  const cancel = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => job?.cancel() }, "Cancel");
  const bar = h("progress", { max: 1, hidden: true, "aria-label": "Plan" });
  const said = h("span", { class: "unit", role: "status", id: "plan-said" });
  element.append(h("div", { class: "reference-head" }, start, bar, cancel, said));

  function busy(on) {
    start.disabled = on;
    cancel.hidden = bar.hidden = !on;
  }

  async function run() {
    const path = `/api/docs/${encodeURIComponent(store.state.doc.doc)}`;
    busy(true);
    bar.removeAttribute("value");
    said.textContent = "";
    try {
      job = follow(api, api.post(`${path}/plan`, {}), (progress) => (bar.value = progress));
      const { strings, less } = await job.result;
      const { file } = await api.post(`${path}/keep-plan`, { job: await job.id });
      const counts = Object.entries(less).map(([quality, count]) => `${quality} ${count}`);
      said.textContent = `saved beside ${file}; strings that cost less, out of ${strings}: ${counts.join(", ")}`;
    } catch (error) {
      said.textContent = error.message;
    } finally {
      job = null;
      busy(false);
    }
  }

  store.on(["doc"], ({ doc }) => {
    const obstacle = doc?.data.obstacle;
    element.hidden = !MEASURED.includes(obstacle?.kind) || Boolean(obstacle.layer) || doc.data.body.mode.length > 0;
  });
}
