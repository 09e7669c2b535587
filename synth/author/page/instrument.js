// The instrument from the side: the whole string and a close-up of what it touches near its end, to scale, with handles;
// the choice of note; with motion.js, the string in slow motion; with body.js, bridge and body that strings share.

import { mount as mountBody } from "./body.js";
import { h, noteName, number } from "./format.js";
import { makeHandles } from "./handle.js";
import { latest } from "./latest.js";
import { mount as mountMotion } from "./motion.js";
import { makeMoving } from "./moving.js";
import { makePanel } from "./panel.js";
import { closeView, drawScene, handlesOf, wholeView } from "./scene.js";

export function mount(element, { store, api }) {
  const facts = h("dl", { class: "facts" });
  const note = h("select", { id: "note", "aria-label": "Note" });
  const lower = h("button", { type: "button", class: "icon", tabindex: -1, "aria-label": "Lower note" }, "‹");
  const higher = h("button", { type: "button", class: "icon", tabindex: -1, "aria-label": "Higher note" }, "›");
  const whole = makePanel("whole", "The whole string, to scale");
  const close = makePanel("close", "Close-up of the contact");
  const wholeCaption = h("figcaption");
  const closeCaption = h("figcaption");
  const closeFigure = h("figure", { class: "stage close" }, closeCaption, close.svg);
  const reason = h("p", { class: "stage-reason", hidden: true });
  const film = h("div", { class: "film", role: "group", "aria-label": "Slow motion" });
  const bridge = h("div", { class: "body-view" });
  element.append(
    h(
      "div",
      { class: "instrument-head" },
      h("h2", { id: "instrument-heading", class: "hidden-text" }, "Instrument"),
      h("div", { class: "note-choice" }, lower, note, higher),
      facts,
    ),
    h("div", { class: "stages" }, h("figure", { class: "stage whole" }, wholeCaption, whole.svg), closeFigure),
    reason,
    film,
    bridge,
  );

  let drawing = null;
  let ghost = null;
  let ghostKey = "";
  let hand = false;
  let played = null;
  const body = mountBody(bridge, { store, api });
  const motion = mountMotion(film, { store, panels: { whole, close }, redraw: draw, watch: body.show });
  const edits = makeMoving(store, { held: (now) => (hand = now), redraw: draw });
  const wholeHandles = makeHandles(whole, edits);
  const closeHandles = makeHandles(close, edits);

  const ask = latest(async () => {
    const { doc, note: wanted, velocity: force, which } = store.state;
    if (doc === null) return;
    try {
      drawing = await store.view("instrument", { note: wanted, velocity: force, which });
    } catch (error) {
      reason.hidden = false;
      reason.textContent = error.message;
      return;
    }
    const again = played?.doc === doc.doc && played.note === wanted && played.which === which;
    if (again && played.table !== drawing.table && played.string !== drawing.string) {
      store.notify(`${noteName(wanted)} is now played by the ${drawing.string} string`);
    }
    played = { doc: doc.doc, note: wanted, which, string: drawing.string, table: drawing.table };
    store.setTable(drawing.table);
    element.dataset.shows = `${doc.doc} ${drawing.table}`;
    draw();
    await askGhost();
  });

  /** The saved version of the same note, while something is edited. */
  async function askGhost() {
    const { doc, note: wanted, velocity: force, which } = store.state;
    const key = doc.dirty && which === "current" ? JSON.stringify([doc.doc, wanted, force, doc.saved]) : "";
    if (key === ghostKey) return;
    ghostKey = key;
    ghost = key === "" ? null : await store.view("instrument", { note: wanted, velocity: force, which: "saved" }).catch(() => null);
    draw();
  }

  function draw() {
    if (drawing === null) return;
    const view = closeView(drawing);
    closeFigure.hidden = view === null;
    element.classList.toggle("with-close", view !== null);
    whole.measure();
    close.measure();
    // while something is dragged the scale stays
    if (!hand) {
      whole.frame(wholeView(drawing, motion.film()));
      if (view !== null) close.frame(view);
    }
    drawScene(whole, drawing, { close: false, ghost });
    const hasClose = view !== null;
    wholeHandles.show(store.state.which === "saved" ? [] : handlesOf(whole, drawing, { close: false, hasClose }));
    if (hasClose) {
      drawScene(close, drawing, { close: true, ghost });
      closeHandles.show(store.state.which === "saved" ? [] : handlesOf(close, drawing, { close: true, hasClose }));
      closeCaption.textContent = `${drawing.kind === "bridge" ? "The bridge" : "Near the saddle"}, heights × ${number(close.stretch(), 2)}`;
    }
    const string = `${drawing.string} string${drawing.fret ? `, fret ${drawing.fret}` : ""}`;
    const version = store.state.which === "saved" ? "as saved: " : "";
    wholeCaption.textContent = `${version}${string}, velocity ${store.state.velocity}, heights × ${number(whole.stretch(), 2)}`;
    motion.draw();
    reason.hidden = drawing.playable;
    reason.textContent = drawing.playable ? "" : `This note cannot sound: ${drawing.reason}`;
    facts.replaceChildren(
      fact("Pitch", number(drawing.frequency_hz, 5), "Hz"),
      fact("Length", number(1000 * drawing.length_m, 4), "mm"),
      fact("Tension", number(drawing.tension_n, 3), "N"),
      fact("B", number(drawing.inharmonicity, 3), ""),
    );
  }

  const fact = (name, value, unit) => h("div", {}, h("dt", {}, name), h("dd", {}, value, h("span", { class: "unit" }, unit && ` ${unit}`)));

  const step = (by) => {
    const { notes } = store.state.doc;
    const next = notes[notes.indexOf(store.state.note) + by];
    if (next !== undefined) store.setNote(next);
  };
  lower.addEventListener("click", () => step(-1));
  higher.addEventListener("click", () => step(1));
  note.addEventListener("change", () => store.setNote(Number(note.value)));

  let listed = "";
  store.on(["doc", "note"], ({ doc, note: chosen }) => {
    if (doc === null) return;
    const text = doc.notes.join();
    if (text !== listed) {
      listed = text;
      note.replaceChildren(...doc.notes.map((one) => h("option", { value: one }, noteName(one))));
    }
    note.value = chosen;
    lower.disabled = chosen === doc.notes[0];
    higher.disabled = chosen === doc.notes.at(-1);
  });
  store.on(["doc", "note", "velocity", "which"], ask);
  new ResizeObserver(draw).observe(whole.svg);
}
