// Set-up: where the strings of the edited preset buzz under a stroke, drawn over the neck and to be heard; and the set-up that
// a wish asks for. Both are computed beside the server.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { theme } from "./figure.js";
import { h, onScheme, same } from "./format.js";
import { follow } from "./job.js";
import { SHARES, inWords, makeNeckMap, shade, thresholdVelocity, where } from "./neck-map.js";

const STROKES = ["soft", "medium", "hard"];
const USUAL = "medium";
const EXAMPLES = ["no buzz at medium", "no buzz at hard, except frets 13-20 medium", "no buzz at medium, except open strings hard"];
/** What a number in a cell is, over each kind of obstacle that has numbers. */
const HITS = [
  ["frets", "Number: the fret that it hits. "],
  ["board", "Number: where it hits the board, in mm. "],
];
const LONGEST = "longest buzz at medium";

/** What is computed in the background: a button that begins it, its progress, its end, its error. */
function makeRun({ api, label, id, tip, name }) {
  let job = null;
  const start = h("button", { type: "submit", id, title: tip }, label);
  const cancel = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => stop() }, "Cancel");
  const bar = h("progress", { max: 1, hidden: true, "aria-label": name });
  const error = h("p", { class: "fit-refusal", role: "alert", hidden: true });

  function busy(on) {
    start.disabled = on;
    cancel.hidden = bar.hidden = !on;
    if (on) bar.removeAttribute("value");
  }

  function stop() {
    job?.cancel();
  }

  /** What is asked for; null where it was stopped or refused. */
  async function ask(path, fields) {
    error.hidden = true;
    busy(true);
    try {
      job = follow(api, api.post(path, fields), (progress) => progress > 0 && (bar.value = progress));
      return await job.result;
    } catch (reason) {
      error.textContent = reason.message;
      error.className = reason.message === "Cancelled" ? "muted" : "fit-refusal";
      error.hidden = false;
      return null;
    } finally {
      job = null;
      busy(false);
    }
  }

  return { start, cancel, bar, error, ask, stop };
}

export function mount(element, { store, api }) {
  /** What is shown: {doc, data, stroke, velocity, lines, notes}; what is proposed: {doc, lines, changes}. */
  let found = null;
  let proposal = null;
  let shownDoc = null;

  // ---- head
  const mapRun = makeRun({
    api,
    label: "Compute",
    id: "compute-map",
    name: "Buzz map",
    tip: "Plucks every string at every fret harder and harder, from soft to twice the hardest stroke; this takes some seconds to a minute",
  });
  const stroke = h(
    "select",
    { id: "map-stroke", title: "Place, width and speed of the finger are this stroke's; notes that buzz at it are marked" },
    ...STROKES.map((name) => h("option", { value: name, selected: name === USUAL }, name)),
  );
  const said = h("span", { class: "unit", role: "status", id: "map-said" });
  const head = h(
    "form",
    { class: "setup-head" },
    h("h2", {}, "Set-up"),
    h("label", { class: "setup-choice" }, h("span", {}, "Stroke"), stroke),
    mapRun.start,
    mapRun.bar,
    mapRun.cancel,
    said,
  );
  head.addEventListener("submit", (event) => {
    event.preventDefault();
    compute();
  });

  // ---- the map
  const intro = h(
    "p",
    { class: "muted" },
    "The buzz map tells, for each string at each fret, how far you may draw the string before it buzzes, and on what.",
  );
  const map = makeNeckMap({ told: tell, hear });
  const swatches = SHARES.map((share) => h("i", { class: "swatch", "aria-hidden": "true" }));
  const hits = h("span", {});
  const legend = h(
    "p",
    { class: "setup-legend unit" },
    h("span", {}, "Buzzes from, of the stroke: "),
    ...SHARES.map((share, i) => h("span", { class: "swatch-text" }, swatches[i], `${100 * share} %`)),
    h("span", {}, hits, "* buzzes at this stroke, ? may, ~ comes and goes (chaotic), – no buzz, × rests on it."),
  );
  const place = h("strong", {});
  const words = h("span", {});
  const play = (threshold, label, tip) =>
    h("button", { type: "button", class: "quiet small", title: tip, onclick: () => map.looked && hear(map.looked, { threshold }) }, label);
  const hearStroke = play(false, "Hear the stroke", "Plays the note on this string with the map's stroke: click it on the map, or Enter");
  const hearThreshold = play(true, "Hear the threshold", "Plays it as hard as it begins to buzz: Shift and click, or Shift and Enter");
  hearStroke.id = "hear-stroke";
  hearThreshold.id = "hear-threshold";
  const reading = h("div", { class: "setup-reading", id: "map-reading" }, h("p", {}, place, " ", words), h("div", {}, hearStroke, hearThreshold));
  const summary = h("ul", { class: "setup-lines" });
  const result = h("div", { class: "setup-result", id: "map-result", hidden: true }, map.element, reading, legend, summary);

  // ---- the wish
  const wishRun = makeRun({
    api,
    label: "Propose",
    id: "propose",
    name: "Proposal",
    tip: "Finds the lowest action and relief that keep the wish, or the bridge that buzzes longest; seconds to a few minutes",
  });
  const wish = h("input", { type: "text", id: "wish", list: "wishes", autocomplete: "off", spellcheck: "false", required: true });
  const examples = h("datalist", { id: "wishes" });
  const lines = h("p", { class: "setup-proposal", id: "proposal" });
  const apply = h("button", { type: "button", class: "primary", id: "apply-set-up", onclick: take }, "Apply");
  const proposed = h("div", { class: "setup-proposed", hidden: true }, lines, apply);
  const ask = h(
    "form",
    { class: "setup-wish" },
    h("label", { class: "setup-choice wide" }, h("span", {}, "Wish"), wish),
    wishRun.start,
    wishRun.bar,
    wishRun.cancel,
  );
  ask.addEventListener("submit", (event) => {
    event.preventDefault();
    propose();
  });
  element.append(head, mapRun.error, intro, result, h("section", { class: "setup-wishes", "aria-label": "Wish" }, ask, examples, wishRun.error, proposed));

  const path = (what) => `/api/docs/${encodeURIComponent(store.state.doc.doc)}/${what}`;

  async function compute() {
    const { doc } = store.state;
    said.textContent = "";
    const made = await mapRun.ask(path("buzz-map"), { stroke: stroke.value });
    if (store.state.doc?.doc !== doc.doc) return;
    if (made !== null) {
      found = { ...made, doc: doc.doc, data: doc.data };
      intro.hidden = true;
      hits.textContent = HITS.find(([kind]) => kind === doc.data.obstacle.kind)?.[1] ?? "";
      result.hidden = false;
      summary.replaceChildren(...found.lines.map((line) => h("li", {}, line)));
      tell(null);
      draw();
    }
    age();
  }

  function draw() {
    const { dark } = theme();
    SHARES.forEach((share, i) => (swatches[i].style.background = shade(share, dark).fill));
    map.show(found?.notes ?? null, dark);
  }

  /** What is said of a note that is looked at. */
  function tell(note) {
    place.textContent = note === null ? "" : `${where(note)}:`;
    words.textContent = note === null ? "Point at a note of the neck, or go to it with Tab and the arrow keys." : inWords(note);
    hearStroke.disabled = note === null;
    hearThreshold.disabled = note === null || thresholdVelocity(note) === null;
  }

  function hear(note, { threshold }) {
    const velocity = threshold ? thresholdVelocity(note) : found.velocity;
    if (velocity === null) {
      store.notify(`${where(note)} has no threshold to hear`);
      return;
    }
    store.hear({ note: note.key, velocity, string: note.table, opened: note.opened });
  }

  /** Say when the map is one of an earlier state of the preset. */
  function age() {
    if (found === null) return;
    const fresh = same(store.state.doc?.data, found.data);
    result.classList.toggle("old", !fresh);
    const about = `${found.stroke} stroke, velocity ${found.velocity}`;
    said.textContent = fresh ? about : `${about}: the preset has been edited since; compute it again`;
  }

  async function propose() {
    const { doc } = store.state;
    proposed.hidden = true;
    const made = await wishRun.ask(path("set-up"), { wish: wish.value });
    if (made === null || store.state.doc?.doc !== doc.doc) return;
    proposal = made;
    lines.textContent = made.lines.join("\n");
    proposed.hidden = false;
  }

  async function take() {
    apply.disabled = true;
    const state = await store.editMany(proposal.changes);
    apply.disabled = false;
    if (state === null) store.notify("The proposed set-up is refused: see the marked controls", "error");
    else store.notify("The controls now hold the proposed set-up; undo reverts it");
  }

  store.on(["doc"], ({ doc }) => {
    if ((doc?.doc ?? null) !== shownDoc) {
      shownDoc = doc?.doc ?? null;
      mapRun.stop();
      wishRun.stop();
      found = proposal = null;
      map.show(null, false);
      result.hidden = proposed.hidden = mapRun.error.hidden = wishRun.error.hidden = true;
      intro.hidden = false;
      said.textContent = "";
      const fitting = doc?.data.obstacle.kind === "bridge" ? [LONGEST, ...EXAMPLES] : EXAMPLES;
      examples.replaceChildren(...fitting.map((value) => h("option", { value })));
      wish.value = fitting[0];
    } else age();
  });
  store.on(["theme"], () => found !== null && draw());
  onScheme(() => found !== null && draw());
}
