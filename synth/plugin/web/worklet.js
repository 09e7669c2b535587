// The engine in the audio thread. It is given the bytes of the module and of the bank when it is made, and only events later.
//
// in   {kind, channel, a, b, value}   an event of jawari.h
//      {midi: Uint8Array}             a MIDI message
//      {drone: "start" | "stop" | "seconds" | "velocity" | "tonic", value}
//      {reset: true}                  silence, everything as it came
//      {rest: boolean}                compute nothing, as nobody listens
//      {warm: true}                   go on with the warm-up
//      {close: true}                  end, and let the memory go
//      {measure: number}              asks for figures; {clear: true, room} begins anew with them
// out  {warming: true}, whenever a slice of the warm-up is done; then {ready: what the bank says of itself, load: share of its
//      time that a heavy block takes, took_ms}, or {failed: why}; {figures, measure: number}

import { Drone } from "./drone.js";
import { PARAMETER } from "./events.js";
import { clock, Measure } from "./measure.js";
import { Module } from "./module.js";
import { warmUp } from "./warm.js";

/** Of computing before anybody listens at a time, so that others sound on [ms]. */
const SLICE_MS = 20;

class Instrument extends AudioWorkletProcessor {
  constructor({ processorOptions: { wasm, bank, measure, again } }) {
    super();
    this.resting = false;
    this.measure = measure ? new Measure() : null;
    this.module = this.drone = null;
    this.begun = Date.now();
    try {
      const module = new Module(wasm, bank, sampleRate);
      this.described = module.described();
      const score = module.score();
      if (score) this.drone = new Drone(module, score, sampleRate);
      this.warming = warmUp(module, this.drone, this.described, sampleRate, clock, again);
      this.port.onmessage = ({ data }) => this.warm(module, data);
      this.port.postMessage({ warming: true });
    } catch (error) {
      this.port.postMessage({ failed: error.message });
    }
  }

  /** Some of the warm-up; behind it, it can be played. What is played before is not heard. */
  warm(module, { warm, close }) {
    if (close) this.end();
    if (close || !warm) return;
    const until = clock() + SLICE_MS;
    while (clock() < until) {
      const { done, value } = this.warming.next();
      if (!done) continue;
      this.module = module;
      this.warming = null;
      this.asItCame();
      this.port.onmessage = ({ data }) => this.hear(data);
      const ready = { ...this.described, drone: this.drone && this.drone.settings };
      this.port.postMessage({ ready, load: value, took_ms: Date.now() - this.begun });
      return;
    }
    this.port.postMessage({ warming: true });
  }

  end() {
    this.module = this.drone = this.warming = this.port.onmessage = null;
  }

  asItCame() {
    if (!this.drone) return;
    this.drone.reset();
    for (const { index, initial } of this.described.presets[this.drone.part].parameters) this.drone.heed(this.drone.part, index, initial);
  }

  hear(data) {
    const { module, drone } = this;
    if (data.kind !== undefined) {
      module.put(0, data.kind, data.channel, data.a, data.b, data.value);
      if (data.kind === PARAMETER) drone?.heed(data.channel, data.a, data.value);
    } else if (data.midi) module.putMidi(data.midi);
    else if (data.drone === "start") drone?.start();
    else if (data.drone === "stop") drone?.stop();
    else if (data.drone) drone?.set(data.drone, data.value);
    else if (data.reset) {
      module.reset();
      this.asItCame();
      this.fading = true;
    } else if (data.rest !== undefined) this.resting = data.rest;
    else if (data.close) this.end();
    else if (data.clear) this.measure?.clear(data.room);
    else if (data.measure !== undefined) this.tell(data.measure);
  }

  tell(number) {
    const { module } = this;
    const figures = { ...this.measure?.figures(), voices: module.voices(), notes: module.notes(), dropped: module.dropped };
    this.port.postMessage({ figures, measure: number });
  }

  process(inputs, outputs) {
    const { module, drone, measure } = this;
    if (!module) return this.port.onmessage !== null; // it is being warmed, or closed
    const left = outputs[0][0];
    const waits = drone !== null && drone.waits();
    if (this.resting || (!waits && !this.fading && module.silent())) return true;
    this.fading = false;
    const begun = measure ? clock() : 0;
    if (drone) drone.play(left.length);
    module.play(left, outputs[0][1]);
    if (measure) measure.block(clock() - begun, (1000 * left.length) / sampleRate, left, outputs[0][1]);
    return true;
  }
}

registerProcessor("jawari", Instrument);
