// The drone that a bank may hold, at its own pace: plugin_drone.c without a host. The score is that of drone_score.h.

import { NOTE_OFF, NOTE_ON, PARAMETER, TUNING } from "./events.js";

const SCORE_BYTES = 160;
const OWN_BYTES = 288;
const STROKE_BYTES = 40;
/** Its parameters, in the order of the score, that are set here. */
const SETTINGS = { seconds: 2, velocity: 4, tonic: 5 };

export class Drone {
  /**
   * @param {import("./module.js").Module} module
   * @param {number} at the score's address
   * @param {number} rate the sample rate [Hz]
   */
  constructor(module, at, rate) {
    this.module = module;
    this.rate = rate;
    const view = new DataView(module.x.memory.buffer);
    const int = (place) => view.getInt32(at + place, true);
    const real = (place) => view.getFloat64(at + place, true);
    const [strings, strokes, parameters, steps] = [0, 4, 8, 12].map(int);
    [this.part, this.channel, this.positionIndex, this.widthIndex] = [16, 20, 24, 28].map(int);
    [this.stepLow, this.leadS, this.semitoneS, this.stepS] = [32, 40, 48, 56].map(real);
    this.strings = strings;
    this.strokes = strokes;
    this.steps = steps;
    this.keys = Int32Array.from({ length: strings }, (_, k) => int(64 + 4 * k));
    this.places = Float64Array.from({ length: strings }, (_, k) => real(96 + 8 * k));
    const pitches = SCORE_BYTES + parameters * OWN_BYTES;
    this.pitches = Float64Array.from({ length: steps * strings }, (_, k) => real(pitches + 8 * k));
    const first = pitches + 8 * steps * strings;
    this.hand = Float64Array.from({ length: (strokes * STROKE_BYTES) / 8 }, (_, k) => real(first + 8 * k));
    /** What can be set: as a live parameter of a preset. */
    this.settings = {};
    for (const [name, k] of Object.entries(SETTINGS)) {
      const place = SCORE_BYTES + k * OWN_BYTES;
      const [minimum, maximum, initial] = [0, 8, 16].map((each) => real(place + each));
      const text = (each) => module.text(at + place + each);
      const described = { curve: int(place + 24), id: text(32), name: text(80), unit: text(176) };
      this.settings[name] = { ...described, minimum, maximum, initial };
    }
    this.position = 0;
    this.width = 0;
    this.now = 0;
    this.reset();
  }

  /** Silent, as it came. */
  reset() {
    this.running = false;
    this.plucked = false;
    this.held = -1;
    this.turn = -1;
    this.origin = 0;
    this.anchor = 0;
    this.anchorS = 0;
    this.next = 0;
    this.seconds = this.settings.seconds.initial;
    this.velocity = this.settings.velocity.initial;
    this.tonic = this.wanted = this.settings.tonic.initial;
  }

  /** Whether it will have events. */
  waits() {
    return this.running || this.turn >= 0;
  }

  start() {
    if (this.running) return;
    this.running = true;
    this.origin = this.now;
    this.anchor = 0;
    this.anchorS = this.leadS;
    this.next = 0;
  }

  /** As fast as it can be played. */
  hurry() {
    this.set("seconds", this.settings.seconds.minimum);
    this.start();
  }

  stop() {
    if (this.running) this.letGo(0);
    this.running = false;
  }

  /** name: one of `settings`. */
  set(name, value) {
    const { minimum, maximum } = this.settings[name];
    const kept = Math.min(Math.max(value, minimum), maximum);
    if (name === "velocity") this.velocity = kept;
    else if (name === "seconds") {
      const before = this.due(this.next, false);
      this.seconds = kept;
      this.anchor = this.placeOf(this.next);
      this.anchorS = 0;
      this.anchorS = before - this.due(this.next, false);
    } else {
      this.wanted = kept;
      if (!this.plucked) this.turnPegs(0, Infinity);
      else if (this.turn < 0) this.turn = this.now;
    }
  }

  /** A live parameter was set: a stroke varies these two. */
  heed(part, index, value) {
    if (part !== this.part) return;
    if (index === this.positionIndex) this.position = value;
    if (index === this.widthIndex) this.width = value;
  }

  placeOf(n) {
    const string = n % this.strings;
    return (n - string) / this.strings + this.places[string];
  }

  variation(n, k) {
    return this.hand[(n % this.strokes) * (STROKE_BYTES / 8) + k];
  }

  /** Behind the origin [s]. */
  due(n, jitter) {
    const strays = this.variation(n, jitter ? 0 : 1);
    return this.anchorS + (this.placeOf(n) - this.anchor) * this.seconds + strays * this.seconds;
  }

  /** The events of the next frames. */
  play(frames) {
    const until = this.now + frames;
    for (;;) {
      const due = this.origin + Math.round(this.due(this.next, true) * this.rate);
      const stroke = this.running ? Math.max(due, this.now) : Infinity;
      const peg = this.turn < 0 ? Infinity : Math.max(this.turn, this.now);
      if (stroke >= until && peg >= until) break;
      if (peg <= stroke) this.turnPegs(peg - this.now, this.stepS / this.semitoneS);
      else this.pluck(stroke - this.now);
    }
    this.now = until;
  }

  letGo(frame) {
    if (this.held >= 0) this.module.put(frame, NOTE_OFF, this.channel, this.held, 64, 0);
    this.held = -1;
  }

  finger(frame, position, width) {
    this.module.put(frame, PARAMETER, this.part, this.positionIndex, 0, position);
    this.module.put(frame, PARAMETER, this.part, this.widthIndex, 0, width);
  }

  pluck(frame) {
    const n = this.next++;
    const key = this.keys[n % this.strings];
    this.letGo(frame);
    const velocity = Math.min(Math.max(Math.round(this.velocity * this.variation(n, 2)), 1), 127);
    this.finger(frame, this.position + this.variation(n, 3), this.width * this.variation(n, 4));
    this.module.put(frame, NOTE_ON, this.channel, key, velocity, 0);
    this.finger(frame, this.position, this.width); // as the player of other notes has it
    this.held = key;
    this.plucked = true;
  }

  /** Turn the pegs on their way by this many semitones at most, all strings together. */
  turnPegs(frame, most) {
    const { wanted } = this;
    this.tonic = this.tonic < wanted ? Math.min(this.tonic + most, wanted) : Math.max(this.tonic - most, wanted);
    this.turn = this.tonic === wanted ? -1 : this.now + frame + Math.max(1, Math.round(this.stepS * this.rate));
    const step = this.tonic - this.stepLow;
    const low = Math.min(Math.floor(step), this.steps - 1);
    for (let k = 0; k < this.strings; k++) {
      const below = this.pitches[low * this.strings + k];
      const above = step > low ? this.pitches[(low + 1) * this.strings + k] : below;
      this.module.put(frame, TUNING, 0, this.keys[k], 1, below + (above - below) * (step - low));
    }
  }
}
