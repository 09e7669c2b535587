// The sound in the browser: blocks of float samples from the server, played as they are by an AudioWorklet.

const HEADER_BYTES = 8;
const HEARD_EVERY_MS = 50;
const SILENT_AFTER_MS = 2000;

/**
 * link: {send(message)} to the server; what comes back is given to message() and receive().
 *
 * Events (detail): "received" {stream, frame, samples} as the server sent them, "began" {stream, time_s,
 * context} (the first frame goes out at this time of the audio context), "played" {stream, frame, samples} as they went
 * out, all interleaved stereo; "status" (see .status), "failed" {message}.
 */
export class Player extends EventTarget {
  constructor(link) {
    super();
    this.link = link;
    this.output = "browser";
    this.rateHz = null;
    this.stream = 0;
    this.context = null;
    this.node = null;
    this.volume = null;
    this.gainDb = 0;
    this.ready = null;
    this.lastHeard = 0;
    this.silenced = null;
    this.silent = false;
    this.early = [];
    this.status = { sounding: false, starved: 0, dropped: 0, cpu: null, stream: 0 };
  }

  /** Make the audio context at the server's rate; browsers let it sound only after a click, touch or key. */
  unlock(rateHz = this.rateHz) {
    if (this.context && rateHz && this.context.sampleRate !== rateHz) this.close();
    if (rateHz) this.rateHz = rateHz;
    if (!this.ready) {
      this.ready = this.open(this.rateHz).catch((error) => {
        this.ready = null;
        this.fail(`no sound in this browser: ${error.message}; choose the server's output`);
      });
    }
    if (this.context?.state === "suspended") this.context.resume();
    return this.ready;
  }

  async open(rateHz) {
    const context = new AudioContext({ latencyHint: "interactive", ...(rateHz ? { sampleRate: rateHz } : {}) });
    this.context = context;
    if (context.state === "suspended") context.resume();
    await context.audioWorklet.addModule(new URL("pcm-worklet.js", import.meta.url));
    if (this.context !== context) return;
    this.node = new AudioWorkletNode(context, "jawari-pcm", { numberOfInputs: 0, outputChannelCount: [2] });
    this.volume = new GainNode(context, { gain: gainOf(this.gainDb) });
    this.node.connect(this.volume).connect(context.destination);
    this.node.port.onmessage = ({ data }) => this.told(data);
    for (const block of this.early.splice(0)) this.node.port.postMessage(block, [block.samples.buffer]);
  }

  close() {
    this.context?.close();
    this.context = this.node = this.volume = this.ready = null;
  }

  /** dB, 0: the samples as they are. */
  setGain(db) {
    this.gainDb = db;
    if (this.volume) this.volume.gain.setTargetAtTime(gainOf(db), this.context.currentTime, 0.01);
  }

  chooseOutput(id) {
    this.output = id;
    this.silence();
    this.link.send({ type: "output", id });
  }

  /** phrase: note, drone, riff or scale; which: current or saved; where `on` has a string and its open note, on that one
   * alone. The engine begins from silence. */
  audition(phrase, { note, velocity, which, ...on }) {
    if (this.output === "browser") this.unlock();
    this.link.send({ type: "audition", phrase, note, velocity, which, ...on });
  }

  stop() {
    this.link.send({ type: "stop" });
    this.silence();
  }

  /** Fade what sounds here and forget what is queued; blocks of that stream still under way are left out. */
  silence() {
    this.silenced = this.stream;
    this.node?.port.postMessage({ stop: true });
    this.early.length = 0;
    this.change({ sounding: false });
  }

  /** Another connection: nothing of the one before comes any more. */
  restart() {
    this.silence();
    this.silenced = null;
    if (this.output !== "browser") this.link.send({ type: "output", id: this.output });
  }

  /** A text message of the server that concerns sound. */
  message(message) {
    if (message.type === "audio") {
      this.node?.port.postMessage({ stop: true });
      this.stream = message.stream;
      this.silenced = null;
      if (message.rate_hz !== this.context?.sampleRate && this.output === "browser") this.unlock(message.rate_hz);
      this.change({ sounding: true, stream: message.stream });
      setTimeout(() => this.complain(message.stream), SILENT_AFTER_MS);
    } else if (message.type === "stopped") {
      this.node?.port.postMessage({ end: this.stream });
      this.change({ sounding: false });
    } else if (message.type === "load") this.change({ cpu: message.cpu });
  }

  /** A binary message: uint32 stream, uint32 frame, float32 stereo interleaved, little-endian. */
  receive(buffer) {
    const header = new DataView(buffer, 0, HEADER_BYTES);
    const stream = header.getUint32(0, true);
    const frame = header.getUint32(4, true);
    const samples = new Float32Array(buffer, HEADER_BYTES);
    this.dispatchEvent(new CustomEvent("received", { detail: { stream, frame, samples: samples.slice() } }));
    if (stream === this.silenced) return;
    const block = { stream, frame, samples: samples.slice() };
    if (this.node) this.node.port.postMessage(block, [block.samples.buffer]);
    else this.early.push(block);
  }

  told(data) {
    if (data.played !== undefined) {
      this.dispatchEvent(
        new CustomEvent("played", { detail: { stream: data.played, frame: data.frame, samples: data.samples } }),
      );
      const now = performance.now();
      if (now - this.lastHeard >= HEARD_EVERY_MS) {
        this.lastHeard = now;
        this.link.send({ type: "heard", frame: data.frame + data.samples.length / 2 });
      }
    } else if (data.began !== undefined) {
      // without asking outputLatency, for whose answer Firefox may wait for ever while it opens the device
      this.dispatchEvent(
        new CustomEvent("began", { detail: { stream: data.began, time_s: data.time, context: this.context } }),
      );
    } else if (data.starved !== undefined) {
      if (this.status.sounding) this.change({ starved: this.status.starved + 1 });
    } else if (data.dropped !== undefined) this.change({ dropped: this.status.dropped + data.dropped });
  }

  /** Say so, once, where the browser gives no sound: without a device, or held back, its audio stands still. */
  complain(stream) {
    if (this.output !== "browser" || this.stream !== stream || !this.status.sounding) return;
    const silent = this.context?.state !== "running";
    if (silent && !this.silent)
      this.fail("this browser plays no sound: allow this page to play audio, plug in an audio output, or choose the server's output");
    this.silent = silent;
  }

  change(part) {
    Object.assign(this.status, part);
    this.dispatchEvent(new CustomEvent("status", { detail: this.status }));
  }

  fail(message) {
    this.dispatchEvent(new CustomEvent("failed", { detail: { message } }));
  }
}

const gainOf = (db) => (db <= -60 ? 0 : 10 ** (db / 20));
