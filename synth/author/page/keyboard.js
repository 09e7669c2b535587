// The keyboard of the dock: a piano, or the neck or strings of the instrument; mouse, touch, computer keys, MIDI.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { refine } from "./fine.js";
import { h, noteName } from "./format.js";
import { connectMidi, midiGranted } from "./midi.js";
import { toolbar } from "./roving.js";

// By place on the keyboard, whatever the letters are there: the keys of a piano from C on, as `synth play` has them.
const PIANO = [
  "KeyA",
  "KeyW",
  "KeyS",
  "KeyE",
  "KeyD",
  "KeyF",
  "KeyT",
  "KeyG",
  "KeyY",
  "KeyH",
  "KeyU",
  "KeyJ",
  "KeyK",
  "KeyO",
  "KeyL",
  "KeyP",
  "Semicolon",
  "Quote",
];
const LETTERS = [..."awsedftgyhujkolp;'"];
const BLACK = new Set([1, 3, 6, 8, 10]);
const VELOCITY_STEP = 12;
const VELOCITY_SLIDER_STEP = 4;
const LAYOUT = "jawari-keyboard";
const FOLDED = "jawari-keyboard-folded";
// What stands for octaves that are left out, in white keys.
const GAP = 0.6;

/** The octaves that have notes, at least two, as runs of adjacent ones: [[first C, last B], …]. */
export function compass(notes) {
  const octaves = [...new Set(notes.map((note) => Math.floor(note / 12)))].sort((a, b) => a - b);
  if (octaves.length === 1) octaves.unshift(octaves[0] - 1);
  if (octaves[0] < 0) octaves.push(octaves.shift() + 2);
  const runs = [];
  for (const octave of octaves) {
    const [first, last] = [12 * octave, 12 * octave + 11];
    if (runs.at(-1)?.[1] === first - 1) runs.at(-1)[1] = last;
    else runs.push([first, last]);
  }
  return runs;
}

/** Rows of a neck, the highest string first: [{name, open, frets}]; null where the strings are not few. */
export function neck(data) {
  const strings = data?.string ?? [];
  const kind = data?.obstacle?.kind;
  const frets = kind === "frets" ? data.obstacle.count : kind === "board" ? (data.obstacle.semitones ?? 24) : 0;
  // a string of several notes is no string but a choir of them
  if (strings.length < 2 || strings.some(({ notes }) => notes[0] !== notes[1])) return null;
  const rows = strings.map(({ name, notes }) => ({ name, open: notes[0], frets }));
  return frets ? rows.reverse() : rows;
}

export function mount(element, { store, api }) {
  const held = new Map();
  const pointers = new Map();
  const typed = new Map();
  let octave = 3;
  let layout = localStorage.getItem(LAYOUT) ?? "piano";
  let sustained = false;
  let shape = "";
  let latched = null;

  // ---- playing
  /** The notes of the version that is shown. */
  const notesShown = () => {
    const { doc, which } = store.state;
    return (which === "saved" ? doc?.saved_notes : doc?.notes) ?? [];
  };
  const playable = (key) => notesShown().includes(key);
  /** Keys that switch articulations, [{key, name}], of the version that is shown. */
  const switchesShown = () => {
    const { doc, which } = store.state;
    return (which === "saved" ? doc?.saved_switches : doc?.switches) ?? [];
  };
  const switches = (key) => switchesShown().some((one) => one.key === key);
  const keysOf = (key) => element.querySelectorAll(`[data-key="${key}"]`);

  function press(key, velocity = store.state.velocity) {
    if (!playable(key) && !switches(key)) return false;
    if (switches(key)) {
      latched = key;
      markSwitches();
    }
    held.set(key, (held.get(key) ?? 0) + 1);
    api.socket.send({ type: "note_on", key, velocity, which: store.state.which });
    for (const one of keysOf(key)) one.classList.add("down");
    return true;
  }

  function release(key) {
    const count = held.get(key) ?? 0;
    if (count > 1) held.set(key, count - 1);
    else if (count === 1) {
      held.delete(key);
      api.socket.send({ type: "note_off", key });
      for (const one of keysOf(key)) one.classList.remove("down");
    }
  }

  function releaseAll() {
    pointers.clear();
    typed.clear();
    for (const key of [...held.keys()]) {
      held.set(key, 1);
      release(key);
    }
    if (sustained) pedal(false);
  }

  function pedal(down) {
    sustained = down;
    api.socket.send({ type: "pedal", down });
    sustain.setAttribute("aria-pressed", String(down));
  }

  function midi(message) {
    if (message.type === "note_on") press(message.key, message.velocity);
    else if (message.type === "note_off") release(message.key);
    else if (message.type === "pedal") pedal(message.down);
    else api.socket.send(message);
  }

  // ---- head
  const keys = h("div", {
    class: "keys",
    role: "slider",
    tabindex: 0,
    "aria-label": "Note; Enter plays it",
    "aria-valuemin": 0,
    "aria-valuemax": 127,
  });
  const chosen = h("output", { class: "key-note" });
  const velocity = h("input", {
    type: "range",
    min: 1,
    max: 127,
    "aria-label": "Velocity",
    title: "Velocity (c v)",
  });
  const usual = store.state.velocity;
  refine(velocity, {
    place: () => store.state.velocity,
    move: (wanted) => store.setVelocity(wanted),
    reset: () => store.setVelocity(usual),
    step: VELOCITY_SLIDER_STEP,
    least: 1,
  });
  const velocityText = h("output", { class: "unit" });
  const sustain = h(
    "button",
    { type: "button", class: "quiet", "aria-pressed": "false", title: "Sustain (space)", onclick: () => pedal(!sustained) },
    "Sustain",
  );
  const layouts = h("span", { class: "segments", role: "group", "aria-label": "Layout" });
  const midiButton = h("button", { type: "button", class: "quiet", onclick: startMidi }, "MIDI");
  const midiText = h("span", { class: "unit midi-text", role: "status" });
  const fold = h("button", {
    type: "button",
    class: "quiet key-fold",
    onclick: () => {
      localStorage.setItem(FOLDED, keys.hidden ? "no" : "yes");
      unfold(keys.hidden);
    },
  });
  const hint = h("span", { class: "unit key-hint" });
  // where there is little room
  const more = h("button", { type: "button", class: "quiet small dock-more", "aria-expanded": "false", onclick: () => open() }, "More…");
  function open() {
    const shown = element.closest(".dock").classList.toggle("open");
    more.textContent = shown ? "Less" : "More…";
    more.setAttribute("aria-expanded", String(shown));
  }
  const tools = h("span", { class: "key-tools", role: "toolbar", "aria-label": "Keyboard" }, sustain, layouts, midiButton, fold);
  toolbar(tools);
  element.append(
    h(
      "div",
      { class: "keyboard-head" },
      chosen,
      h("label", { class: "key-velocity" }, h("span", { class: "unit" }, "Velocity"), velocity, velocityText),
      more,
      tools,
      midiText,
      hint,
    ),
    keys,
  );

  /** Show the keys, or leave their room to the pictures; computer keys and MIDI play all the same. */
  function unfold(shown) {
    keys.hidden = !shown;
    element.classList.toggle("with-keys", shown);
    fold.textContent = shown ? "Hide keys" : "Show keys";
    fold.setAttribute("aria-expanded", String(shown));
    if (shown && store.state.doc) show(store.state.note);
  }
  unfold(localStorage.getItem(FOLDED) !== "yes");

  function startMidi() {
    connectMidi(midi, (text, inputs) => {
      midiText.textContent = text;
      midiButton.disabled = inputs === null;
      midiButton.setAttribute("aria-pressed", String(Boolean(inputs)));
    });
  }
  midiGranted().then((granted) => granted && startMidi());

  // ---- keys
  function piano(notes) {
    const runs = compass(notes);
    const whites = runs.reduce((sum, [low, high]) => sum + (7 * (high + 1 - low)) / 12, GAP * (runs.length - 1));
    const bed = h("div", { class: "piano" });
    bed.style.setProperty("--whites", whites);
    let place = 0;
    for (const [i, [low, high]] of runs.entries()) {
      if (i > 0) {
        const title = `${noteName(runs[i - 1][1] + 1)} to ${noteName(low - 1)}: no string plays them`;
        const gap = h("div", { class: "key-gap", title }, "…");
        gap.style.left = `${(100 * place) / whites}%`;
        gap.style.width = `${(100 * GAP) / whites}%`;
        bed.append(gap);
        place += GAP;
      }
      place = octaves(bed, low, high, place, whites);
    }
    return bed;
  }

  /** Keys from low to high, beginning `place` white keys from the left of `whites`; where they end. */
  function octaves(bed, low, high, place, whites) {
    for (let key = low; key <= high; key++) {
      const black = BLACK.has(key % 12);
      const label = key % 12 === 0 ? h("span", { class: "key-name" }, noteName(key)) : null;
      const one = h(
        "div",
        { class: `key ${black ? "black" : "white"}`, "data-key": key },
        h("span", { class: "key-letter" }),
        label,
      );
      one.style.left = `${(100 * (place - (black ? 0.31 : 0))) / whites}%`;
      bed.append(one);
      if (!black) place += 1;
    }
    return place;
  }

  function fretboard(rows) {
    const bed = h("div", { class: rows[0].frets ? "neck" : "neck open" });
    // The open string's field before the nut is as wide as the first fret's; the others narrow as on the instrument.
    const edge = (fret) => 1 - 2 ** (-fret / 12);
    const nut = edge(1);
    const whole = edge(rows[0].frets) + nut || 1;
    bed.append(
      ...rows.map((row) => {
        const line = h("div", { class: "neck-row" }, h("span", { class: "neck-name" }, row.name || noteName(row.open)));
        const string = h("div", { class: "neck-string" });
        for (let fret = 0; fret <= row.frets; fret++) {
          const key = row.open + fret;
          const field = h(
            "div",
            { class: fret ? "key field" : "key field nut", "data-key": key },
            h("span", {}, noteName(key)),
          );
          field.style.left = `${fret ? (100 * (nut + edge(fret - 1))) / whole : 0}%`;
          field.style.width = `${row.frets ? (100 * (fret ? edge(fret) - edge(fret - 1) : nut)) / whole : 100}%`;
          string.append(field);
        }
        line.append(string);
        return line;
      }),
    );
    return bed;
  }

  /** The keys that switch articulations, with the name of each; hidden where there are none. */
  function switchRow() {
    const all = switchesShown();
    const row = h("div", { class: "key-switches", role: "group", "aria-label": "Articulations" });
    row.hidden = all.length === 0;
    row.append(
      ...all.map(({ key, name }) =>
        h(
          "div",
          { class: "key switch", "data-key": key, title: `${noteName(key)} switches to ${name}` },
          h("span", { class: "switch-name" }, name),
          h("span", { class: "switch-note" }, noteName(key)),
        ),
      ),
    );
    return row;
  }

  function markSwitches() {
    const all = switchesShown();
    const normal = all.find(({ name }) => name === "normal") ?? all[0];
    const now = switches(latched) ? latched : normal?.key;
    for (const one of keys.querySelectorAll(".switch")) one.classList.toggle("latched", Number(one.dataset.key) === now);
  }

  function build() {
    const { doc } = store.state;
    if (notesShown().length === 0) {
      keys.replaceChildren(h("p", { class: "muted" }, doc ? "No note of this preset can be played." : ""));
      return;
    }
    const rows = neck(store.data());
    const choices = [["piano", "Piano"], ...(rows ? [["neck", rows[0].frets ? "Neck" : "Strings"]] : [])];
    const shown = rows && layout === "neck" ? "neck" : "piano";
    layouts.hidden = choices.length < 2;
    layouts.replaceChildren(
      ...choices.map(([name, label]) =>
        h("button", { type: "button", "aria-pressed": String(shown === name), onclick: () => change(name) }, label),
      ),
    );
    keys.replaceChildren(switchRow(), shown === "neck" ? fretboard(rows) : piano(notesShown()));
    markSwitches();
    for (const one of keys.querySelectorAll(".key:not(.switch)")) {
      const key = Number(one.dataset.key);
      one.classList.toggle("mute", !playable(key));
      one.title = noteName(key) + (playable(key) ? "" : ": no string plays it");
    }
    letters();
    mark();
    show(store.state.note);
  }

  function change(name) {
    layout = name;
    localStorage.setItem(LAYOUT, name);
    build();
    layouts.querySelector("[aria-pressed=true]")?.focus();
  }

  function letters() {
    for (const one of keys.querySelectorAll(".key-letter")) {
      const letter = LETTERS[Number(one.parentElement.dataset.key) - 12 * (octave + 1)];
      one.textContent = letter ?? "";
    }
    hint.textContent = `computer keys from ${noteName(12 * (octave + 1))} · z x octave · c v velocity`;
  }

  function mark() {
    const { note } = store.state;
    for (const one of keys.querySelectorAll(".key.chosen")) one.classList.remove("chosen");
    for (const one of keysOf(note)) one.classList.add("chosen");
    chosen.textContent = noteName(note);
    keys.setAttribute("aria-valuenow", note);
    keys.setAttribute("aria-valuetext", noteName(note));
  }

  /** Scroll a note into the middle, where the keys are wider than the screen. */
  function show(note) {
    const one = keys.querySelector(`[data-key="${note}"]`);
    if (!one || keys.scrollWidth <= keys.clientWidth) return;
    const place = one.getBoundingClientRect().left - keys.getBoundingClientRect().left;
    if (place < 0 || place > keys.clientWidth - one.clientWidth) keys.scrollLeft += place - keys.clientWidth / 2;
  }

  // ---- mouse and touch: sliding plays what is slid over
  const keyAt = (event) => {
    const one = document.elementFromPoint(event.clientX, event.clientY)?.closest?.(".key");
    return one && keys.contains(one) ? Number(one.dataset.key) : null;
  };
  keys.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    const key = keyAt(event);
    if (key === null) return;
    keys.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, press(key) ? key : null);
    if (playable(key)) store.setNote(key);
  });
  keys.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const [before, key] = [pointers.get(event.pointerId), keyAt(event)];
    if (key === before || key === null) return;
    if (before !== null) release(before);
    pointers.set(event.pointerId, press(key) ? key : null);
    if (playable(key)) store.setNote(key);
  });
  for (const type of ["pointerup", "pointercancel", "lostpointercapture"]) {
    keys.addEventListener(type, (event) => {
      const key = pointers.get(event.pointerId);
      pointers.delete(event.pointerId);
      if (key !== undefined && key !== null) release(key);
    });
  }

  // ---- the note by arrow keys, where the keyboard has the focus
  keys.addEventListener("keydown", (event) => {
    const notes = store.state.doc?.notes ?? [];
    const at = notes.indexOf(store.state.note);
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 12, PageDown: -12 }[event.key];
    if (step) store.setNote(notes[Math.max(0, Math.min(notes.length - 1, at + step))]);
    else if (event.key === "Home") store.setNote(notes[0]);
    else if (event.key === "End") store.setNote(notes.at(-1));
    else if (event.key === "Enter" && !event.repeat && !typed.has("Enter")) {
      if (press(store.state.note)) typed.set("Enter", store.state.note);
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });

  // ---- computer keys, unless somebody writes
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || !store.state.doc) return;
    if (event.target.closest?.("input:not([type=range], [type=checkbox]), textarea, select, dialog, [contenteditable]"))
      return;
    const place = PIANO.indexOf(event.code);
    if (place >= 0) {
      const key = 12 * (octave + 1) + place;
      if (!typed.has(event.code) && press(key)) {
        typed.set(event.code, key);
        if (playable(key)) store.setNote(key);
      }
    } else if (event.code === "KeyZ" || event.code === "KeyX") {
      octave = Math.max(-1, Math.min(8, octave + (event.code === "KeyX" ? 1 : -1)));
      letters();
    } else if (event.code === "KeyC" || event.code === "KeyV") {
      store.setVelocity(store.state.velocity + (event.code === "KeyV" ? VELOCITY_STEP : -VELOCITY_STEP));
    } else if (event.code === "Space" && !event.target.closest?.("button, a, input, summary, [role=button]")) {
      if (!sustained) pedal(true);
    } else return;
    event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    const name = event.key === "Enter" ? "Enter" : event.code;
    if (typed.has(name)) {
      const key = typed.get(name);
      typed.delete(name);
      release(key);
    } else if (event.code === "Space" && sustained && !event.target.closest?.("button")) pedal(false);
  });
  window.addEventListener("blur", releaseAll);

  // ---- following the store
  store.on(["doc", "which"], ({ doc }) => {
    const next = doc && JSON.stringify([doc.doc, notesShown(), neck(store.data()), switchesShown()]);
    if (next === shape) return;
    const other = !shape || !doc || JSON.parse(shape)[0] !== doc.doc;
    shape = next ?? "";
    if (other && doc?.notes.length) octave = Math.floor(store.state.note / 12) - 1;
    releaseAll();
    build();
  });
  store.on(["note"], ({ note }) => {
    mark();
    show(note);
  });
  store.on(["velocity"], (state) => {
    velocity.value = state.velocity;
    velocityText.textContent = state.velocity;
  });
}
