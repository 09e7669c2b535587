// The engine's WebAssembly module in the audio thread, and what its memory holds. All names that it exports are used here only.

const WHY_BYTES = 512;
const MOST_FRAMES = 1024;
const MOST_EVENTS = 4096;
const EVENT_BYTES = 32;
const MIDI_BYTES = 1024;
/** Where a bank's header says where its drone is, 0: there is none (`bankfile.HEADER`). */
const DRONE_AT = 312;
const MAGIC = "JAWARIBK";

/** An engine and its bank in a module of their own. Nothing is allocated after it is made. */
export class Module {
  /**
   * @param {ArrayBuffer} wasm
   * @param {ArrayBuffer} bank as `synth export` writes it, packed or not
   * @param {number} rate the sample rate [Hz]
   */
  constructor(wasm, bank, rate) {
    try {
      this.x = new WebAssembly.Instance(new WebAssembly.Module(wasm), {}).exports;
    } catch (error) {
      throw new Error(`the engine (WebAssembly) cannot be loaded: ${error.message}`);
    }
    const { x } = this;
    x._initialize?.();
    this.why = this.room(WHY_BYTES);
    const given = this.unpacked(this.stored(bank), bank.byteLength);
    const opened = x.jawari_open_bytes(given.at, given.size, this.why);
    if (!opened) throw new Error(this.reason());
    this.bank = opened;
    this.engine = x.jawari_create(opened, rate, 1, this.why);
    if (!this.engine) throw new Error(this.reason());
    this.bytes = given.at;
    this.events = this.room(EVENT_BYTES * MOST_EVENTS);
    this.left = this.room(4 * MOST_FRAMES);
    this.right = this.room(4 * MOST_FRAMES);
    this.midi = this.room(MIDI_BYTES);
    this.report = this.room(64);
    this.count = 0;
    this.dropped = 0;
    this.look();
  }

  /** Room in the module's memory. */
  room(bytes) {
    const { x } = this;
    const at = x.jawari_alloc(bytes);
    if (!at) throw new Error(`the browser has no memory left for this instrument (${Math.ceil(bytes / 1e6)} MB more)`);
    return at;
  }

  release(at) {
    const { x } = this;
    x.jawari_free(at);
  }

  stored(bytes) {
    const at = this.room(bytes.byteLength);
    new Uint8Array(this.x.memory.buffer).set(new Uint8Array(bytes), at);
    return at;
  }

  /** The bank in a packed one, which goes; of another as it is. */
  unpacked(at, size) {
    const { x } = this;
    const begin = String.fromCharCode(...new Uint8Array(x.memory.buffer, at, Math.min(size, MAGIC.length)));
    if (begin === MAGIC) return { at, size };
    const whole = Number(x.jawari_unpacked_size(at, size));
    if (whole < 0) return { at, size };
    const out = this.room(whole);
    if (x.jawari_unpack(at, size, out, whole, this.why) !== 0) throw new Error(this.reason());
    this.release(at);
    return { at: out, size: whole };
  }

  /** Views of the memory, which are made anew where it has grown. */
  look() {
    if (this.buffer === this.x.memory.buffer) return;
    this.buffer = this.x.memory.buffer;
    this.view = new DataView(this.buffer);
    this.leftView = new Float32Array(this.buffer, this.left, MOST_FRAMES);
    this.rightView = new Float32Array(this.buffer, this.right, MOST_FRAMES);
    this.midiView = new Uint8Array(this.buffer, this.midi, MIDI_BYTES);
    this.outFrames = 0;
  }

  reason() {
    return this.text(this.why);
  }

  /** Text of an address, up to its zero. */
  text(at) {
    const bytes = new Uint8Array(this.x.memory.buffer);
    let escaped = "";
    for (let k = at; bytes[k]; k++) escaped += `%${bytes[k].toString(16).padStart(2, "0")}`;
    return decodeURIComponent(escaped);
  }

  /** What the bank says of itself. */
  described() {
    const { x, bank } = this;
    const view = new DataView(x.memory.buffer);
    const presets = [];
    for (let k = 0; k < x.jawari_presets(bank); k++) {
      const at = x.jawari_preset_of(bank, k);
      const [id, name, description] = [0, 4, 8].map((place) => this.text(view.getUint32(at + place, true)));
      const [lowest, highest] = [12, 16].map((place) => view.getInt32(at + place, true));
      presets.push({ id, name, description, lowest, highest, parameters: [] });
    }
    for (let k = 0; k < x.jawari_parameters(bank); k++) {
      const at = x.jawari_parameter_of(bank, k);
      const [part, index, curve] = [0, 4, 8].map((place) => view.getInt32(at + place, true));
      const [id, name, unit] = [12, 16, 20].map((place) => this.text(view.getUint32(at + place, true)));
      const [minimum, maximum, initial] = [24, 32, 40].map((place) => view.getFloat64(at + place, true));
      presets[part].parameters.push({ index, curve, id, name, unit, minimum, maximum, initial });
    }
    const [id, name] = [x.jawari_bank_id(bank), x.jawari_bank_name(bank)].map((at) => this.text(at));
    return { id, name, presets, strings: x.jawari_strings(bank), version: this.text(x.jawari_version()) };
  }

  /** Address of the drone's score in the bank, 0: there is none. */
  score() {
    const at = Number(new DataView(this.x.memory.buffer).getBigUint64(this.bytes + DRONE_AT, true));
    return at && this.bytes + at;
  }

  /** An event of the next block. Those of a block come in order of their frames. */
  put(frame, kind, channel, a, b, value) {
    if (this.count === MOST_EVENTS) {
      this.dropped++;
      return;
    }
    const { view } = this;
    const at = this.events + EVENT_BYTES * this.count++;
    view.setInt32(at, frame, true);
    view.setInt32(at + 4, 0, true);
    view.setInt32(at + 8, kind, true);
    view.setInt32(at + 12, channel, true);
    view.setInt32(at + 16, a, true);
    view.setInt32(at + 20, b, true);
    view.setFloat64(at + 24, value, true);
  }

  /** A MIDI message. */
  putMidi(bytes) {
    if (bytes.length > MIDI_BYTES) return;
    this.midiView.set(bytes);
    const at = this.events + EVENT_BYTES * this.count;
    this.count += this.x.jawari_midi(this.midi, bytes.length, 0n, at, MOST_EVENTS - this.count);
  }

  /** The next block with the events put since the last. */
  play(left, right) {
    this.look();
    const frames = left.length;
    if (frames !== this.outFrames) {
      this.outFrames = frames;
      this.leftOut = this.leftView.subarray(0, frames);
      this.rightOut = this.rightView.subarray(0, frames);
    }
    this.x.jawari_process_float(this.engine, this.events, this.count, frames, this.left, this.right);
    this.count = 0;
    left.set(this.leftOut);
    right.set(this.rightOut);
  }

  silent() {
    return this.count === 0 && this.x.jawari_silent(this.engine) !== 0;
  }

  reset() {
    this.count = 0;
    this.x.jawari_reset(this.engine);
  }

  voices() {
    return this.x.jawari_voices(this.engine);
  }

  /** Notes plucked, and those that found no string. */
  notes() {
    return this.reported(8);
  }

  unplayed() {
    return this.reported(16);
  }

  reported(place) {
    this.x.jawari_report_of(this.engine, this.report);
    return Number(this.view.getBigInt64(this.report + place, true));
  }
}
