// Phrases, where the sound comes out, volume and level.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.
//
// The element passes on the player's events "received", "began" and "played" (see pcm.js).

import { refine } from "./fine.js";
import { h, noteName, number, onScheme } from "./format.js";
import { theme } from "./figure.js";
import { Player } from "./pcm.js";
import { toolbar } from "./roving.js";

const PHRASES = [
  ["note", "Note", "The selected note, held for two seconds, then released"],
  ["drone", "Drone", "The strings in turn, as on a tanpura"],
  ["riff", "Figure", "A short figure that suits the instrument"],
  ["scale", "Scale", "A scale through the compass"],
];
/** What the figure is of some families: the button's name and tip. */
const FIGURES = {
  bass: ["Riff", "A bass line"],
  sitar: ["Alap", "A slow line around Sa"],
  veena: ["Alap", "A slow line around Sa"],
};
const AUTO = "jawari-play-changes";
const VOLUME = "jawari-volume";
const PLAY_EVERY_MS = 150;
const TOUCHED_WITHIN_MS = 3000;
const LOWEST_DB = -60;

export function mount(element, { store, api }) {
  const player = new Player(api.socket);
  for (const type of ["received", "began", "played"])
    player.addEventListener(type, (event) => element.dispatchEvent(new CustomEvent(type, { detail: event.detail })));
  player.addEventListener("failed", (event) => store.notify(event.detail.message, "error"));
  for (const type of ["audio", "stopped", "load"]) api.socket.on(type, (message) => player.message(message));
  api.socket.on("binary", (buffer) => player.receive(buffer));
  api.socket.on("open", () => player.restart());
  api.socket.on("closed", () => player.silence());

  const play = (phrase) => {
    const { note, velocity, which } = store.state;
    player.audition(phrase, { note, velocity, which });
  };
  store.onHear((wanted) => player.audition("note", { which: "current", ...wanted }));
  const phrases = PHRASES.map(([phrase, label, tip]) =>
    h("button", { type: "button", "data-phrase": phrase, title: tip, onclick: () => play(phrase) }, label),
  );
  const figure = phrases[PHRASES.findIndex(([phrase]) => phrase === "riff")];
  store.on(["doc"], ({ doc }) => {
    const [, label, tip] = PHRASES.find(([phrase]) => phrase === "riff");
    [figure.textContent, figure.title] = FIGURES[doc?.data.family] ?? [label, tip];
    // a tanpura's strings in turn are its drone
    figure.hidden = doc?.data.family === "tanpura";
  });
  const stop = h(
    "button",
    { type: "button", class: "quiet", title: "Silence (Backspace)", onclick: () => player.stop() },
    "Stop",
  );
  const auto = h("input", { type: "checkbox", onchange: () => localStorage.setItem(AUTO, auto.checked ? "yes" : "no") });
  auto.checked = localStorage.getItem(AUTO) !== "no";

  const outputs = h("span", { class: "segments", role: "radiogroup", "aria-label": "Sound output" });
  const why = h("button", { type: "button", class: "quiet small player-why", hidden: true, "data-tip-tap": true }, "why not?");
  const volume = h("input", {
    type: "range",
    min: LOWEST_DB,
    max: 6,
    step: "any",
    "aria-label": "Volume in the browser",
  });
  const volumeText = h("output", { class: "unit" });
  const meter = levelMeter();
  const load = h("span", { class: "unit player-load" });

  function setVolume(db) {
    player.setGain(db);
    volume.value = db;
    volumeText.textContent = db <= LOWEST_DB ? "off" : `${db > 0 ? "+" : ""}${number(db, 3)} dB`;
    volume.setAttribute("aria-valuetext", volumeText.textContent);
    localStorage.setItem(VOLUME, db);
  }
  setVolume(Number(localStorage.getItem(VOLUME) ?? 0));
  refine(volume, {
    place: () => Number(volume.value),
    move: (db, { fine }) => setVolume(fine ? Math.round(10 * db) / 10 : Math.round(db)),
    reset: () => setVolume(0),
    step: 1,
  });

  const bar = h("span", { class: "player-phrases", role: "toolbar", "aria-label": "Phrases" }, ...phrases, stop);
  toolbar(bar);
  element.append(
    bar,
    h("label", { class: "player-volume" }, volume, volumeText),
    h("span", { class: "player-level" }, meter.element, meter.text),
    h("label", { class: "check" }, auto, "after each change"),
    h("span", { class: "player-output" }, h("span", { class: "unit" }, "Sound from"), outputs, why),
    load,
  );

  // ---- where the sound comes out
  store.on(["session"], ({ session }) => {
    player.rateHz = session?.rate_hz ?? null;
    const choices = (session?.outputs ?? []).map((output) =>
      h(
        "button",
        {
          type: "button",
          role: "radio",
          "data-output": output.id,
          disabled: !output.available,
          "aria-checked": String(player.output === output.id),
          tabindex: player.output === output.id ? 0 : -1,
          title: output.reason || null,
          onclick: () => choose(output.id),
          onkeydown: (event) => arrow(event, output.id),
        },
        output.label,
      ),
    );
    outputs.replaceChildren(...choices);
    const missing = (session?.outputs ?? []).find((output) => !output.available);
    why.hidden = !missing;
    if (missing) {
      why.dataset.tip = missing.reason;
      why.setAttribute("aria-label", `${missing.label}: why not? ${missing.reason}`);
    }
  });

  function choose(id) {
    player.chooseOutput(id);
    for (const one of outputs.children) {
      one.setAttribute("aria-checked", String(one.dataset.output === id));
      one.tabIndex = one.dataset.output === id ? 0 : -1;
    }
    volume.disabled = id !== "browser";
  }

  function arrow(event, id) {
    if (!["ArrowLeft", "ArrowRight"].includes(event.key)) return;
    const other = [...outputs.children].find((one) => one.dataset.output !== id && !one.disabled);
    if (!other) return;
    event.preventDefault();
    choose(other.dataset.output);
    other.focus();
  }

  // ---- a browser sounds only after the first click, touch or key; what was played before waits for it
  let touched = -Infinity;
  for (const type of ["pointerdown", "keydown", "input"]) {
    document.addEventListener(
      type,
      () => {
        touched = performance.now();
        if (type !== "input" && player.output === "browser" && player.rateHz) player.unlock();
      },
      { capture: true, passive: true },
    );
  }

  // ---- after each change in this tab: hear it, not more often than one can follow
  let heard = null;
  let timer = 0;
  let last = -Infinity;
  store.on(["doc", "which"], ({ doc, which }) => {
    const now = doc && { doc: doc.doc, revision: doc.revision, which };
    const before = heard;
    heard = now;
    if (!now || !before || before.doc !== now.doc || !auto.checked) return;
    if (before.revision === now.revision && before.which === now.which) return;
    if (performance.now() - touched > TOUCHED_WITHIN_MS) return;
    clearTimeout(timer);
    const wait = last + PLAY_EVERY_MS - performance.now();
    const go = () => {
      last = performance.now();
      play("note");
    };
    if (wait <= 0) go();
    else timer = setTimeout(go, wait);
  });

  // ---- how it goes
  player.addEventListener("played", (event) => meter.feed(event.detail.samples));
  player.addEventListener("status", ({ detail }) => {
    element.classList.toggle("sounding", detail.sounding);
    element.dataset.gaps = detail.starved;
    const parts = [];
    if (detail.cpu !== null) parts.push(`load ${Math.round(100 * detail.cpu)} %`);
    if (detail.starved) parts.push(`${detail.starved} ${detail.starved === 1 ? "gap" : "gaps"}`);
    if (detail.dropped) parts.push(`${detail.dropped} frames dropped`);
    load.textContent = parts.join(" · ");
    load.title = detail.starved ? "How many times the sound came too late: the machine is busy" : "";
  });
  document.addEventListener("keydown", (event) => {
    const writing = event.target.closest?.("input:not([type=range], [type=checkbox]), textarea, select");
    if (event.key === "Backspace" && !writing) player.stop();
    if (event.key === "Enter" && !event.target.closest?.("button, input, textarea, select, a, [tabindex], dialog"))
      play("note");
  });
  const seen = () => `${noteName(store.state.note)} at velocity ${store.state.velocity}`;
  store.on(["note", "velocity"], () => (phrases[0].title = `${PHRASES[0][2]}: ${seen()} (Enter)`));
}

/** Peaks of what goes out, −60 to 0 dBFS, falling 20 dB a second, and the highest of what sounds in figures. */
function levelMeter() {
  const canvas = h("canvas", { class: "meter", role: "img", "aria-label": "Level" });
  const text = h("output", { class: "unit meter-peak", title: "Highest peak since the last silence" });
  const FALL_DB_S = 20;
  const HOLD_MS = 1500;
  let levels = [LOWEST_DB, LOWEST_DB];
  let peak = { db: LOWEST_DB, at: 0 };
  let moving = false;
  let before = 0;
  let top_db = LOWEST_DB;

  /** The figure stays when it is silent again, until something else sounds. */
  function say(db) {
    text.textContent = `${number(Math.round(10 * db) / 10)} dBFS`;
    text.classList.toggle("over", db >= 0);
  }

  function feed(samples) {
    if (!moving) top_db = LOWEST_DB;
    for (const side of [0, 1]) {
      let top = 0;
      for (let i = side; i < samples.length; i += 2) top = Math.max(top, Math.abs(samples[i]));
      const db = Math.max(LOWEST_DB, 20 * Math.log10(top || 1e-9));
      levels[side] = Math.max(levels[side], db);
      if (db >= peak.db) peak = { db, at: performance.now() };
      if (db > top_db) say((top_db = db));
    }
    if (!moving && peak.db > LOWEST_DB) {
      moving = true;
      before = performance.now();
      requestAnimationFrame(step);
    }
  }

  function step(now) {
    const fall = (FALL_DB_S * Math.max(0, now - before)) / 1000;
    before = now;
    levels = levels.map((db) => Math.max(LOWEST_DB, db - fall));
    if (now - peak.at > HOLD_MS) peak.db = Math.max(LOWEST_DB, peak.db - fall);
    draw();
    moving = peak.db > LOWEST_DB;
    if (moving) requestAnimationFrame(step);
  }

  function draw() {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    const ratio = devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    const colours = theme();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const at = (db) => ((db - LOWEST_DB) / -LOWEST_DB) * width;
    pen.fillStyle = colours.line;
    for (let db = -50; db < 0; db += 10) pen.fillRect(Math.round(at(db)), 0, 1, height);
    const bar = (height - 2) / 2;
    levels.forEach((db, side) => {
      const y = side * (bar + 2);
      pen.fillStyle = colours.good;
      pen.fillRect(0, y, at(Math.min(db, -6)), bar);
      if (db > -6) {
        pen.fillStyle = db >= 0 ? colours.bad : colours.accent;
        pen.fillRect(at(-6), y, at(Math.min(db, 0)) - at(-6), bar);
      }
    });
    if (peak.db > LOWEST_DB) {
      pen.fillStyle = peak.db >= 0 ? colours.bad : colours.ink;
      pen.fillRect(Math.min(width - 2, at(peak.db)), 0, 2, height);
      canvas.setAttribute("aria-label", `Level, peak ${Math.round(peak.db)} dBFS`);
    }
  }

  onScheme(draw);
  new ResizeObserver(draw).observe(canvas);
  return { element: canvas, text, feed };
}
