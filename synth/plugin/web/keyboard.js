// A piano keyboard for mouse, pen, fingers and the Tab key: as many keys as there is room for, and buttons that move it.

import { element } from "./elements.js";

const NAMES = ["C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B"];
const BLACK = new Set([1, 3, 6, 8, 10]);
/** Width of a white key at least [px]: with a mouse, and under a finger. */
const LEAST_PX = { fine: 30, coarse: 42 };
const SOFT = 25;
const LOUD = 120;
const TYPED = 90;

export const nameOf = (note) => `${NAMES[note % 12]}${Math.floor(note / 12) - 1}`;
const black = (note) => BLACK.has(note % 12);

/** How hard a key is struck at a place of its length, 0 the far end: nearer is louder. */
export const velocityAt = (place) => Math.round(SOFT + (LOUD - SOFT) * Math.min(Math.max(place, 0), 1));

/** White keys of a range, whose ends are white. */
function whites(lowest, highest) {
  let count = 0;
  for (let note = lowest; note <= highest; note++) if (!black(note)) count++;
  return count;
}

export class Keyboard {
  /**
   * @param {(note: number, velocity: number) => void} press
   * @param {(note: number) => void} release
   */
  constructor(press, release) {
    this.plays = () => false;
    this.press = press;
    this.release = release;
    this.lowest = 48;
    this.highest = 72;
    this.first = 48;
    this.chosen = 48;
    /** Who holds a note: a pointer's number, or the name of a key. */
    this.held = new Map();
    this.sounding = new Map();
    this.piano = element("div", { class: "piano", role: "group", "aria-label": "Keyboard" });
    this.down = element("button", { type: "button", class: "octave", text: "−", "aria-label": "An octave lower", click: () => this.shift(-12) });
    this.up = element("button", { type: "button", class: "octave", text: "+", "aria-label": "An octave higher", click: () => this.shift(12) });
    this.where = element("span", { class: "where", "aria-live": "polite" });
    this.octaves = element("div", { class: "octaves", role: "group", "aria-label": "Octave" }, this.down, this.where, this.up);
    this.listen();
    this.width = new ResizeObserver(() => this.draw());
    this.width.observe(this.piano);
  }

  /** The notes that there are, and those among them that play nothing. */
  range(lowest, highest, mute) {
    this.releaseAll();
    this.lowest = black(lowest) ? lowest - 1 : lowest;
    this.highest = black(highest) ? highest + 1 : highest;
    const between = (note) => note >= lowest && note <= highest;
    this.plays = (note) => between(note) && !mute.includes(note);
    this.first = this.fullest();
    this.chosen = lowest;
    this.drawn = "";
    this.draw();
  }

  /** The first note from which on most keys play, of those that there is room for. */
  fullest() {
    let [best, most] = [this.lowest, -1];
    for (let first = this.lowest; first <= this.highest; first++) {
      if (black(first)) continue;
      const last = this.last(first);
      let count = 0;
      for (let note = first; note <= last; note++) if (this.plays(note)) count++;
      if (count > most) [best, most] = [first, count];
    }
    return best;
  }

  /** The last note that there is room for from a first one on. */
  last(first = this.first) {
    const least = matchMedia("(pointer: coarse)").matches ? LEAST_PX.coarse : LEAST_PX.fine;
    let room = Math.max(7, Math.floor(this.piano.clientWidth / least));
    let note = first;
    for (let next = note; next <= this.highest; next++) {
      if (black(next)) continue;
      if (!room--) break;
      note = next;
    }
    return note;
  }

  shift(semitones) {
    const count = this.last() - this.first;
    const most = Math.max(this.highest - count, this.lowest);
    let first = Math.min(Math.max(this.first + semitones, this.lowest), most);
    if (black(first)) first++;
    if (first === this.first) return;
    this.releaseAll();
    this.first = first;
    this.draw();
  }

  draw() {
    if (!this.piano.clientWidth) return;
    const last = this.last();
    const shown = `${this.first}…${last}`;
    if (shown === this.drawn) return;
    this.drawn = shown;
    const count = whites(this.first, last);
    this.piano.style.setProperty("--whites", count);
    if (this.chosen < this.first || this.chosen > last || !this.plays(this.chosen)) {
      this.chosen = this.first;
      while (!this.plays(this.chosen) && this.chosen < last) this.chosen++;
    }
    const keys = [];
    let before = 0;
    for (let note = this.first; note <= last; note++) {
      const dark = black(note);
      const place = dark ? before - 0.31 : before++;
      const key = element(
        "button",
        {
          type: "button",
          class: `key ${dark ? "black" : "white"}`,
          "data-note": note,
          "aria-label": nameOf(note),
          "aria-pressed": "false",
          disabled: !this.plays(note),
          tabindex: note === this.chosen ? 0 : -1,
        },
        element("span", { text: note % 12 === 0 || note === this.first ? nameOf(note) : "" }),
      );
      key.style.setProperty("--place", place);
      keys.push(key);
    }
    this.piano.replaceChildren(...keys);
    this.where.textContent = `${nameOf(this.first)} – ${nameOf(last)}`;
    this.down.disabled = this.first <= this.lowest;
    this.up.disabled = last >= this.highest;
    this.octaves.hidden = this.down.disabled && this.up.disabled;
    for (const note of this.sounding.keys()) this.mark(note);
  }

  key(note) {
    return this.piano.querySelector(`[data-note="${note}"]`);
  }

  mark(note) {
    const key = this.key(note);
    const down = this.sounding.has(note);
    key?.classList.toggle("down", down);
    key?.setAttribute("aria-pressed", String(down));
  }

  /** Show a note that sounds, or no longer does, for somebody else's sake. */
  show(note, on) {
    const count = (this.sounding.get(note) ?? 0) + (on ? 1 : -1);
    if (count > 0) this.sounding.set(note, count);
    else this.sounding.delete(note);
    this.mark(note);
  }

  /** who: a pointer or a key, which holds one note at a time. */
  hold(who, note, velocity) {
    if (this.held.get(who) === note) return;
    this.letGo(who);
    if (!this.plays(note)) return;
    this.held.set(who, note);
    this.show(note, true);
    this.press(note, velocity);
  }

  letGo(who) {
    const note = this.held.get(who);
    if (note === undefined) return;
    this.held.delete(who);
    this.show(note, false);
    if (![...this.held.values()].includes(note)) this.release(note);
  }

  releaseAll() {
    for (const who of [...this.held.keys()]) this.letGo(who);
  }

  /** Show no note any more. */
  forget() {
    const notes = [...this.sounding.keys()];
    this.sounding.clear();
    for (const note of notes) this.mark(note);
  }

  /** The key at a place of the page, and how hard it is struck there. */
  at(x, y) {
    const root = this.piano.getRootNode();
    const key = root.elementFromPoint(x, y)?.closest(".key");
    if (!key || !this.piano.contains(key)) return null;
    const { top, height } = key.getBoundingClientRect();
    return { note: Number(key.dataset.note), velocity: velocityAt((y - top) / height) };
  }

  listen() {
    const { piano } = this;
    piano.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      const found = this.at(event.clientX, event.clientY);
      if (!found) return;
      event.preventDefault();
      piano.setPointerCapture(event.pointerId);
      this.hold(event.pointerId, found.note, found.velocity);
    });
    piano.addEventListener("pointermove", (event) => {
      if (!piano.hasPointerCapture(event.pointerId)) return;
      const found = this.at(event.clientX, event.clientY);
      if (found) this.hold(event.pointerId, found.note, found.velocity);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
      piano.addEventListener(name, (event) => this.letGo(event.pointerId));
    piano.addEventListener("contextmenu", (event) => event.preventDefault());
    piano.addEventListener("keydown", (event) => this.typed(event));
    piano.addEventListener("keyup", (event) => this.letGo(event.code));
    piano.addEventListener("focusout", () => {
      this.letGo("Space");
      this.letGo("Enter");
    });
  }

  typed(event) {
    const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.code];
    if (step) {
      event.preventDefault();
      this.choose(step);
    } else if (event.code === "Space" || event.code === "Enter") {
      event.preventDefault();
      if (!event.repeat) this.hold(event.code, this.chosen, TYPED);
    }
  }

  /** Move the focus to the next key that plays, up (1) or down (−1); an octave on where it is not shown. */
  choose(step) {
    let note = this.chosen + step;
    while (!this.plays(note) && note >= this.lowest && note <= this.highest) note += step;
    if (!this.plays(note)) return;
    if (!this.key(note)) this.shift(12 * step);
    const key = this.key(note);
    if (!key) return;
    this.key(this.chosen)?.setAttribute("tabindex", "-1");
    this.chosen = note;
    key.setAttribute("tabindex", "0");
    key.focus();
  }

  close() {
    this.width.disconnect();
  }
}
