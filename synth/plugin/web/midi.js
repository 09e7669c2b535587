// MIDI keyboards through the browser (Web MIDI), where it has that: the messages of the chosen inputs as they come.

import { element } from "./elements.js";

const ALL = "";

/** Why there is none, from what requestMIDIAccess threw. */
function refusal(error) {
  if (error.name === "NotAllowedError" || error.name === "SecurityError") return "the browser does not allow MIDI for this page";
  if (error.name === "NotSupportedError" || error.name === "InvalidStateError") return "this system has no MIDI";
  return `MIDI: ${error.message}`;
}

/** A button that asks for MIDI, then the choice among the inputs. */
export class MidiInputs {
  /**
   * @param {(bytes: Uint8Array) => void} play
   * @param {(text: string) => void} say
   */
  constructor(play, say) {
    this.play = play;
    this.say = say;
    this.chosen = ALL;
    this.access = null;
    this.ask = element("button", { type: "button", class: "midi", text: "MIDI keyboard", click: () => this.connect() });
    this.select = element("select", { "aria-label": "MIDI input", change: () => this.choose(this.select.value) });
    this.select.hidden = true;
    this.element = element("span", { class: "midi-inputs" }, this.ask, this.select);
  }

  async connect() {
    if (!navigator.requestMIDIAccess) {
      this.say("this browser has no Web MIDI; Chromium, Edge and Firefox have it");
      return;
    }
    try {
      this.access = await navigator.requestMIDIAccess();
    } catch (error) {
      this.say(refusal(error));
      return;
    }
    this.access.onstatechange = () => this.look();
    this.ask.hidden = true;
    this.select.hidden = false;
    this.look();
  }

  inputs() {
    return [...this.access.inputs.values()].filter((input) => input.state === "connected");
  }

  look() {
    const inputs = this.inputs();
    if (!inputs.some((input) => input.id === this.chosen)) this.chosen = ALL;
    const options = inputs.map((input) => element("option", { value: input.id, text: input.name ?? input.id }));
    const all = element("option", { value: ALL, text: inputs.length ? "All MIDI inputs" : "No MIDI keyboard is connected" });
    this.select.replaceChildren(all, ...options);
    this.choose(this.chosen);
  }

  choose(id) {
    this.chosen = id;
    this.select.value = id;
    for (const input of this.inputs()) {
      const heard = id === ALL || input.id === id;
      input.onmidimessage = heard ? ({ data }) => this.play(data) : null;
    }
  }

  close() {
    if (!this.access) return;
    this.access.onstatechange = null;
    for (const input of this.access.inputs.values()) input.onmidimessage = null;
  }
}
