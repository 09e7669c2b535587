// An instrument in an element of a page: its keyboard, its live parameters, its drone.

import { element, toggle } from "./elements.js";
import { Engine } from "./engine.js";
import { Keyboard } from "./keyboard.js";
import { MidiInputs } from "./midi.js";
import { shown, slider } from "./sliders.js";
import { playByTyping } from "./typing.js";

const MODULATION = 1;
const BEND_MOST = 8191;
const CONTROLLER_MOST = 127;
const QUIETEST_DB = -40;
const LOUDEST_DB = 12;
const SLOW_MS = 4000;
const LATE = "This one needs much of the processor here: so that nothing crackles, keys sound some hundredths of a second later.";
const styles = new Map();
let typist = null;

function sheetOf(style) {
  if (!styles.has(style)) {
    const sheet = new CSSStyleSheet();
    styles.set(style, sheet);
    fetch(style).then(
      async (answer) => answer.ok && sheet.replaceSync(await answer.text()),
      () => styles.delete(style),
    );
  }
  return styles.get(style);
}

/**
 * Put an instrument into an element.
 *
 * @param {HTMLElement} place
 * @param {import("./engine.js").Assets & {style: string}} assets addresses of jawari.wasm, the bank, jawari-worklet.js and
 *   jawari.css; of the first two the bytes will do as well
 * @returns {Instrument} its `ready` comes true when it can be played, and is rejected with the reason where it cannot, or was
 *   closed before
 */
export function mountInstrument(place, assets) {
  return new Instrument(place, assets);
}

class Instrument {
  constructor(place, assets) {
    this.place = place;
    this.root = place.shadowRoot ?? place.attachShadow({ mode: "open" });
    this.root.adoptedStyleSheets = [sheetOf(assets.style)];
    this.status = element("p", { class: "status", role: "status", text: "Loading the strings …" });
    this.root.replaceChildren(this.status);
    place.dataset.state = "loading";
    this.closed = false;
    this.ended = [];
    this.sliders = [];
    this.part = 0;
    this.engine = new Engine(assets);
    this.begin();
    this.ready = this.engine.ready.then(
      (bank) => {
        if (this.closed) throw new Error("it was closed");
        this.build(bank);
        place.dataset.state = "ready";
        this.readyAt = performance.now();
        return bank;
      },
      (error) => {
        if (this.closed) throw error;
        this.say(`It cannot be played: ${error.message}`, true);
        place.dataset.state = "failed";
        throw error;
      },
    );
    this.ready.catch(() => {});
  }

  /** While it comes: some browsers make the audio thread only after a person has done something. */
  begin() {
    const wake = () => this.engine.resume();
    const names = ["pointerdown", "keydown"];
    for (const name of names) document.addEventListener(name, wake, { passive: true, capture: true });
    const asking = setTimeout(() => this.say("Loading the strings … press anywhere if this takes long."), SLOW_MS);
    const end = () => {
      clearTimeout(asking);
      for (const name of names) document.removeEventListener(name, wake, { capture: true });
    };
    this.engine.ready.then(end, end);
    this.ended.push(end);
  }

  say(text, wrong = false) {
    this.status.textContent = text;
    this.status.setAttribute("role", wrong ? "alert" : "status");
    this.status.classList.toggle("wrong", wrong);
    this.status.hidden = !text;
  }

  build(bank) {
    const { engine } = this;
    this.bank = bank;
    this.keyboard = new Keyboard(
      (note, velocity) => engine.noteOn(note, velocity),
      (note) => engine.noteOff(note),
    );
    this.midi = new MidiInputs((bytes) => this.heard(bytes), (text) => this.say(text[0].toUpperCase() + text.slice(1) + "."));
    this.parameters = element("div", { class: "parameters", role: "group", "aria-label": "Live parameters" });
    this.sustain = toggle("Hold", (on) => engine.sustain(on), { title: "Like a sustain pedal", class: "hold" });
    const panic = element("button", {
      type: "button",
      class: "panic",
      text: "Stop all",
      title: "All notes off, everything as it came",
      click: () => this.silence(),
    });
    const tools = element("div", { class: "tools" }, this.programs(), this.volume(), this.sustain.element, panic, this.midi.element);
    const wheels = element("div", { class: "wheels" }, this.keyboard.octaves, this.bend(), this.wheel());
    const board = element("div", { class: "board" }, this.keyboard.piano, wheels);
    const hint = element("p", {
      class: "hint",
      text: "Keys A W S E D … of the computer play too, Z and X change the octave. Near its end, a key is louder.",
    });
    const late = engine.ample ? element("p", { class: "hint late", text: LATE }) : "";
    const frame = element("div", { class: "instrument" }, tools, ...this.drone(), board, hint, late, this.parameters, this.status);
    this.say("");
    this.root.replaceChildren(frame);
    this.choose(0);
    this.listen(frame);
  }

  programs() {
    const { presets } = this.bank;
    if (presets.length < 2) return "";
    const options = presets.map(({ name }, part) => element("option", { value: part, text: name }));
    const change = () => {
      this.choose(Number(this.program.value));
      this.engine.program(this.part);
    };
    this.program = element("select", { class: "program", "aria-label": "Instrument", change }, ...options);
    return this.program;
  }

  volume() {
    const range = { id: "volume", name: "Volume", unit: "dB", curve: 0, minimum: QUIETEST_DB, maximum: LOUDEST_DB, initial: 0 };
    return slider(range, (db) => this.engine.volume(db <= QUIETEST_DB ? 0 : 10 ** (db / 20))).element;
  }

  drone() {
    const { drone } = this.bank;
    if (!drone) return [];
    this.droning = toggle("Play the drone", (on) => this.playDrone(on), { class: "primary drone-play" });
    const names = { seconds: "Cycle", velocity: "Loudness", tonic: "Sa" };
    this.droneSliders = Object.entries(names).map(([name, title]) =>
      slider({ ...drone[name], name: title }, (value) => this.engine.drone(name, value)),
    );
    const sliders = this.droneSliders.map((each) => each.element);
    return [element("div", { class: "drone", role: "group", "aria-label": "Drone" }, this.droning.element, ...sliders)];
  }

  playDrone(on) {
    this.engine.drone(on ? "start" : "stop");
    this.droning.element.textContent = on ? "Stop the drone" : "Play the drone";
  }

  bend() {
    const input = element("input", { type: "range", min: -BEND_MOST, max: BEND_MOST, step: 1, value: 0, "data-id": "bend" });
    const change = (to) => {
      input.value = String(to);
      this.engine.bend(Number(input.value));
    };
    input.addEventListener("input", () => change(input.value));
    for (const name of ["change", "pointerup", "pointercancel", "blur"]) input.addEventListener(name, () => change(0));
    this.unbend = () => (input.value = "0");
    return element("label", { class: "wheel" }, element("span", { text: "Bend" }), input);
  }

  wheel() {
    const change = () => this.engine.control(MODULATION, Number(input.value));
    const input = element("input", { type: "range", min: 0, max: CONTROLLER_MOST, step: 1, value: 0, "data-id": "wheel", input: change });
    this.unwheel = () => (input.value = "0");
    return element("label", { class: "wheel" }, element("span", { text: "Wheel" }), input);
  }

  /** Show the preset of this number. */
  choose(part) {
    const { lowest, highest, mute, parameters } = this.bank.presets[part];
    this.part = part;
    if (this.program) this.program.value = String(part);
    this.keyboard.range(lowest, highest, mute);
    this.sliders[part] ??= parameters.map((each) => slider(each, (value) => this.engine.parameter(part, each.index, value)));
    this.parameters.replaceChildren(...this.sliders[part].map((each) => each.element));
  }

  /** A message of a MIDI keyboard. */
  heard(bytes) {
    const [status, first, second] = bytes;
    const message = status & 0xf0;
    this.engine.midi(bytes);
    if (message === 0x90 && second > 0) this.keyboard.show(first, true);
    else if (message === 0x80 || message === 0x90) this.keyboard.show(first, false);
    else if (status === 0xc0 && this.bank.presets[first]) this.choose(first);
  }

  /** All notes off, everything as it came. */
  silence() {
    this.asItCame();
    this.engine.reset();
    if (this.part) this.engine.program(this.part);
  }

  asItCame() {
    this.keyboard.releaseAll();
    this.keyboard.forget();
    this.sustain.set(false);
    this.unbend();
    this.unwheel();
    for (const each of this.sliders.flat()) each?.back();
    if (!this.droning) return;
    this.droning.set(false);
    this.droning.element.textContent = "Play the drone";
    for (const each of this.droneSliders) each.back();
  }

  listen(frame) {
    const { engine, keyboard } = this;
    typist = this;
    const mine = () => (typist = this);
    const wake = () => engine.wake();
    for (const name of ["pointerdown", "focusin"]) frame.addEventListener(name, mine);
    for (const name of ["pointerdown", "pointerup", "touchend", "click", "keydown"])
      frame.addEventListener(name, wake, { passive: true, capture: true });
    this.ended.push(playByTyping(keyboard, () => typist === this));
    engine.addEventListener("rest", () => this.asItCame());
    engine.addEventListener("failed", ({ detail }) => this.say(detail[0].toUpperCase() + detail.slice(1) + ".", true));
    engine.addEventListener("state", () => {
      if (engine.sounding && this.status.classList.contains("wrong")) this.say("");
    });
    const leave = () => keyboard.releaseAll();
    const hide = () => document.hidden && leave();
    window.addEventListener("blur", leave);
    document.addEventListener("visibilitychange", hide);
    this.ended.push(() => {
      window.removeEventListener("blur", leave);
      document.removeEventListener("visibilitychange", hide);
    });
  }

  /** What the audio thread has measured, in words. */
  async measured() {
    const { blocks, late, worst_ms, load, peak } = await this.engine.figures();
    return `${blocks} blocks, ${late} late, worst ${shown(worst_ms, "ms")}, load ${shown(100 * load, "%")}, peak ${shown(peak, "")}`;
  }

  /** Take it out of the page. */
  close() {
    if (this.closed) return;
    this.closed = true;
    if (typist === this) typist = null;
    for (const end of this.ended.splice(0)) end();
    this.keyboard?.close();
    this.midi?.close();
    this.engine.close();
    this.root.replaceChildren();
    delete this.place.dataset.state;
  }
}
