// The engine as a page sees it: a node for each instrument in an audio context that those of a page share.

import { contextOf, programIn } from "./contexts.js";
import { BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM } from "./events.js";
import { hasRelaxedSimd } from "./relaxed.js";

/** Share of a block's time, as the warm-up measures it, above which an instrument moves to the context with more latency. */
const HEAVY = 0.7;
const SUSTAIN = 64;
/** A note that was pressed before the browser let the context sound is held at least so long behind that [ms]. */
const LEAST_HELD_MS = 300;
const FADE_S = 0.015;
/** A context that does not sound so long after a person has done something will not [ms]. */
const SILENT_AFTER_MS = 2000;
const CLOSED = "it was closed";

/** @typedef {string | ArrayBuffer | Promise<ArrayBuffer>} Source an address, or what lies there */
/**
 * relaxed: the engine for browsers that have relaxed SIMD; those take it in the place of wasm, where it comes.
 * @typedef {{wasm: Source, relaxed?: Source, bank: Source, worklet: string, measure?: boolean}} Assets
 */

const fetched = new Map();

/** What was compressed by gzip, for servers that compress nothing; else as it came. */
function uncompressed(bytes) {
  const [first, second] = new Uint8Array(bytes, 0, Math.min(bytes.byteLength, 2));
  if (first !== 0x1f || second !== 0x8b) return bytes;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/** The bytes of a source; of an address once for all instruments of a page. */
function bytesOf(source, what) {
  if (typeof source !== "string") return Promise.resolve(source);
  if (!fetched.has(source)) {
    const coming = fetch(source).then(
      async (answer) => {
        if (!answer.ok) throw new Error(`${what} does not come: ${source}: ${answer.status} ${answer.statusText}`);
        return uncompressed(await answer.arrayBuffer());
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

/** The engine that is best for this browser, of those that come and that it takes. */
async function engineOf(wasm, relaxed) {
  if (relaxed && hasRelaxedSimd()) {
    try {
      const bytes = await bytesOf(relaxed, "the engine");
      if (WebAssembly.validate(bytes)) return bytes;
    } catch {
      // that of all browsers plays the same
    }
  }
  return bytesOf(wasm, "the engine");
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
    this.closed = false;
    const closing = new Promise((_, reject) => (this.end = () => reject(new Error(CLOSED))));
    closing.catch(() => {});
    /** What comes, or that it was closed before. */
    this.unlessClosed = async (coming) => {
      const come = await Promise.race([coming, closing]);
      if (this.closed) throw new Error(CLOSED);
      return come;
    };
    /** What the bank says of itself, once it can be played. Rejected with the reason where it cannot, or was closed before. */
    this.ready = this.open(assets);
    this.ready.catch(() => {});
  }

  async open({ wasm, relaxed, bank, worklet, measure = false }) {
    this.kind = "quick";
    const program = programIn(this.kind, worklet);
    const all = Promise.all([engineOf(wasm, relaxed), bytesOf(bank, "the instrument's bank"), program]);
    const [wasmBytes, bankBytes] = await this.unlessClosed(all);
    const options = { wasm: wasmBytes, bank: bankBytes, measure };
    let answer = await this.unlessClosed(this.made(options));
    this.load = answer.load;
    if (answer.load > HEAVY) {
      this.node.port.postMessage({ close: true });
      const sounded = this.sounding;
      this.kind = "ample";
      await this.unlessClosed(programIn(this.kind, worklet));
      if (sounded) this.context.resume().catch(() => {});
      answer = await this.unlessClosed(this.made({ ...options, again: true }));
    }
    this.tookMs = answer.took_ms;
    this.gain = new GainNode(this.context, { gain: this.level ?? 1 });
    this.node.connect(this.gain).connect(this.context.destination);
    const { context } = this;
    const changed = () => this.dispatchEvent(new Event("state"));
    context.addEventListener("statechange", changed);
    this.unlisten = () => context.removeEventListener("statechange", changed);
    return answer.ready;
  }

  /** A node in the audio thread, warm. */
  made(processorOptions) {
    const node = new AudioWorkletNode(this.context, "jawari", { numberOfInputs: 0, outputChannelCount: [2], processorOptions });
    this.node = node;
    return new Promise((resolve, reject) => {
      node.addEventListener("processorerror", () => {
        const why = "the engine ended in the audio thread; load the page again";
        reject(new Error(why));
        this.fail(why);
      });
      node.port.onmessage = ({ data }) => {
        if (data.figures) {
          this.asked.get(data.measure)?.resolve(data.figures);
          this.asked.delete(data.measure);
        } else if (data.warming) node.port.postMessage({ warm: true });
        else if (data.failed) reject(new Error(data.failed));
        else resolve(data);
      };
    });
  }

  /** Whether the browser computes farther ahead for it. */
  get ample() {
    return this.kind === "ample";
  }

  get context() {
    return contextOf(this.kind);
  }

  /** Whether the browser lets it sound by now. */
  get sounding() {
    return this.context.state === "running";
  }

  /** To be called by what a person does: browsers let a page sound only then. What another instrument plays ends. */
  wake() {
    if (this.closed) return;
    if (playing !== this) {
      playing?.rest();
      playing = this;
      this.send({ rest: false });
    }
    this.resume();
  }

  /** Let the page sound, where what a person has just done allows it. */
  resume() {
    if (this.closed || this.sounding) return;
    this.context.resume().catch(() => {});
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
    this.event(NOTE_ON, 0, note, velocity);
  }

  noteOff(note) {
    const off = () => this.event(NOTE_OFF, 0, note, 64);
    if (this.sounding) off();
    else this.addEventListener("state", () => setTimeout(off, LEAST_HELD_MS), { once: true });
  }

  control(controller, value) {
    this.event(CONTROL, 0, controller, value);
  }

  sustain(on) {
    this.control(SUSTAIN, on ? 127 : 0);
  }

  /** −8192 … 8191 */
  bend(value) {
    this.event(BEND, 0, value);
  }

  program(part) {
    this.event(PROGRAM, 0, part);
  }

  parameter(part, index, value) {
    this.event(PARAMETER, part, index, 0, value);
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
    this.gain?.gain.setTargetAtTime(level, this.context.currentTime, FADE_S);
  }

  /** What the audio thread has measured since the last `clear`, once it can be played. */
  async figures() {
    await this.ready;
    const number = this.number++;
    return new Promise((resolve, reject) => {
      if (this.closed) reject(new Error(CLOSED));
      this.asked.set(number, { resolve, reject });
      this.send({ measure: number });
    });
  }

  /** Measure anew. There is a gap where it is behind by more than the browser computes ahead, which not every browser tells. */
  clear() {
    const { baseLatency, outputLatency } = this.context;
    this.send({ clear: true, room: 1000 * (baseLatency || outputLatency) });
  }

  /** Never to be heard again. */
  close() {
    this.closed = true;
    this.end();
    for (const { reject } of this.asked.values()) reject(new Error(CLOSED));
    this.asked.clear();
    this.unlisten?.();
    if (playing === this) playing = null;
    clearTimeout(this.silent);
    this.send({ close: true });
    this.node?.disconnect();
    this.gain?.disconnect();
  }
}
