// The engine as a page sees it: an audio context that all instruments of a page share, and for each a node in it.

/** The sample rate of banks for pages [Hz]. */
export const RATE_HZ = 48000;
const SUSTAIN = 64;
/** A note that was pressed before the browser let the context sound is held at least so long behind that [ms]. */
const LEAST_HELD_MS = 300;
const FADE_S = 0.015;
/** A context that does not sound so long after a person has done something will not [ms]. */
const SILENT_AFTER_MS = 2000;

/** Kinds of events (jawari.h). */
const EVENTS = { noteOn: 1, noteOff: 2, control: 3, bend: 4, program: 5, parameter: 6 };

/** @typedef {string | ArrayBuffer | Promise<ArrayBuffer>} Source an address, or what lies there */
/** @typedef {{wasm: Source, bank: Source, worklet: string, measure?: boolean}} Assets */

let shared = null;
const modules = new Map();
const fetched = new Map();

function sharedContext() {
  if (shared) return shared;
  if (!globalThis.AudioContext || !globalThis.AudioWorkletNode)
    throw new Error(
      globalThis.isSecureContext === false
        ? "browsers play instruments only over https: or from this machine (http://localhost)"
        : "this browser has no AudioWorklet, by which the strings are computed; a newer one has it",
    );
  try {
    shared = new AudioContext({ sampleRate: RATE_HZ, latencyHint: "interactive" });
  } catch (error) {
    throw new Error(`this browser plays no sound at ${RATE_HZ} Hz, for which the instrument was made: ${error.message}`);
  }
  if (shared.sampleRate !== RATE_HZ)
    throw new Error(`this browser plays at ${shared.sampleRate} Hz only, and the instrument was made for ${RATE_HZ} Hz`);
  return shared;
}

/** The bytes of a source; of an address once for all instruments of a page. */
function bytesOf(source, what) {
  if (typeof source !== "string") return Promise.resolve(source);
  if (!fetched.has(source)) {
    const coming = fetch(source).then(
      (answer) => {
        if (!answer.ok) throw new Error(`${what} does not come: ${source}: ${answer.status} ${answer.statusText}`);
        return answer.arrayBuffer();
      },
      (error) => {
        throw new Error(`${what} does not come: ${source}: ${error.message}`);
      },
    );
    coming.catch(() => fetched.delete(source)); // another try asks again
    fetched.set(source, coming);
  }
  return fetched.get(source);
}

function moduleIn(context, worklet) {
  if (!modules.has(worklet)) modules.set(worklet, context.audioWorklet.addModule(worklet));
  return modules.get(worklet);
}

/** Of the instruments of a page one sounds: the one that was played last. */
let playing = null;

/** Events: "state" when the context begins or ceases to sound, "rest" when another instrument is played, "failed" {detail: why}. */
export class Engine extends EventTarget {
  /** @param {Assets} assets */
  constructor(assets) {
    super();
    this.node = null;
    this.asked = new Map();
    this.number = 0;
    /** What the bank says of itself, once it can be played. Rejected with the reason where it cannot. */
    this.ready = this.open(assets);
    this.ready.catch(() => {});
  }

  async open({ wasm, bank, worklet, measure = false }) {
    const context = sharedContext();
    const module = moduleIn(context, worklet).catch((error) => {
      modules.delete(worklet);
      throw new Error(`the program of the audio thread does not come: ${worklet}: ${error.message}`);
    });
    const [wasmBytes, bankBytes] = await Promise.all([
      bytesOf(wasm, "the engine"),
      bytesOf(bank, "the instrument's bank"),
      module,
    ]);
    const processorOptions = { wasm: wasmBytes, bank: bankBytes, measure };
    const node = new AudioWorkletNode(context, "jawari", { numberOfInputs: 0, outputChannelCount: [2], processorOptions });
    const answer = await new Promise((resolve, reject) => {
      node.addEventListener("processorerror", () => {
        const why = "the engine ended in the audio thread; load the page again";
        reject(new Error(why));
        this.fail(why);
      });
      node.port.onmessage = ({ data }) => {
        if (data.figures) {
          this.asked.get(data.measure)?.(data.figures);
          this.asked.delete(data.measure);
        } else if (data.failed) reject(new Error(data.failed));
        else resolve(data);
      };
    });
    this.node = node;
    this.tookMs = answer.took_ms;
    this.gain = new GainNode(context, { gain: this.level ?? 1 });
    node.connect(this.gain).connect(context.destination);
    context.addEventListener("statechange", () => this.dispatchEvent(new Event("state")));
    return answer.ready;
  }

  /** Whether the browser lets it sound by now. */
  get sounding() {
    return shared?.state === "running";
  }

  /** To be called by what a person does: browsers let a page sound only then. What another instrument plays ends. */
  wake() {
    if (playing !== this) {
      playing?.rest();
      playing = this;
      this.send({ rest: false });
    }
    this.resume();
  }

  /** Let the page sound, where what a person has just done allows it. */
  resume() {
    if (!shared || shared.state === "running") return;
    shared.resume().catch(() => {});
    clearTimeout(this.silent);
    this.silent = setTimeout(() => {
      if (!this.sounding && playing === this) this.fail("this browser plays no sound: allow it, or plug in an audio output");
    }, SILENT_AFTER_MS);
  }

  fail(why) {
    this.dispatchEvent(new CustomEvent("failed", { detail: why }));
  }

  /** Another instrument of the page is played. */
  rest() {
    this.dispatchEvent(new Event("rest"));
    this.send({ reset: true });
    this.send({ rest: true });
  }

  send(message) {
    this.node?.port.postMessage(message);
  }

  event(kind, channel, a, b = 0, value = 0) {
    this.send({ kind, channel, a, b, value });
  }

  noteOn(note, velocity) {
    this.wake();
    this.event(EVENTS.noteOn, 0, note, velocity);
  }

  noteOff(note) {
    const off = () => this.event(EVENTS.noteOff, 0, note, 64);
    if (this.sounding) off();
    else this.addEventListener("state", () => setTimeout(off, LEAST_HELD_MS), { once: true });
  }

  control(controller, value) {
    this.event(EVENTS.control, 0, controller, value);
  }

  sustain(on) {
    this.control(SUSTAIN, on ? 127 : 0);
  }

  /** −8192 … 8191 */
  bend(value) {
    this.event(EVENTS.bend, 0, value);
  }

  program(part) {
    this.event(EVENTS.program, 0, part);
  }

  parameter(part, index, value) {
    this.event(EVENTS.parameter, part, index, 0, value);
  }

  /** A MIDI message as it came. */
  midi(bytes) {
    this.wake();
    this.send({ midi: bytes });
  }

  /** what: "start", "stop", or one of its settings, with a value. */
  drone(what, value = 0) {
    if (what === "start") this.wake();
    this.send({ drone: what, value });
  }

  /** Silence; parameters and controllers as they came. */
  reset() {
    this.send({ reset: true });
  }

  /** 1: as the engine computes it. */
  volume(level) {
    this.level = level;
    this.gain?.gain.setTargetAtTime(level, shared.currentTime, FADE_S);
  }

  /** What the audio thread has measured since the last `clear`. */
  figures() {
    const number = this.number++;
    return new Promise((resolve) => {
      this.asked.set(number, resolve);
      this.send({ measure: number });
    });
  }

  clear() {
    this.send({ clear: true });
  }

  /** Never to be heard again. */
  close() {
    if (playing === this) playing = null;
    clearTimeout(this.silent);
    this.send({ close: true });
    this.gain?.disconnect();
  }
}
