// Plays interleaved stereo blocks one after another, in the audio thread, exactly as they came.
//
// in   {stream, frame, samples}   a block: which stream, its first frame there, Float32Array of 2 × frames
//      {end: stream}              no more will come of this stream: what is queued is played out
//      {stop: true}               fade what sounds, forget what is queued; the next block begins a stream
// out  {began: stream, time}      the first frame of a stream goes out, at this time of the context (s)
//      {played: stream, frame, samples}  what went out, in chunks, `frame` being the first one's number
//      {starved: stream, frame}   the queue ran dry in mid-stream; {dropped: frames} too much was waiting
// A block of a new stream takes the place of the one that sounds, which fades out over it.

const QUANTUM = 128;
const FADE_FRAMES = 256;
// A stream begins with the first of these waiting, and goes on with the second once it has run dry.
const CUSHIONS_S = [0.02, 0.06];
const LONGEST_S = 2;
const REPORT_FRAMES = 1024;

class Queue {
  constructor(stream, frame) {
    this.stream = stream;
    this.frame = frame;
    this.blocks = [];
    this.place = 0;
    this.waiting = 0;
    this.ended = false;
    this.flowing = false;
    this.begun = false;
  }

  push(samples) {
    this.blocks.push(samples);
    this.waiting += samples.length / 2;
  }

  /** Take up to `count` frames into left and right from `start` on; how many there were. */
  take(left, right, start, count) {
    let done = 0;
    while (done < count && this.blocks.length) {
      const block = this.blocks[0];
      const here = Math.min(count - done, (block.length - this.place) / 2);
      for (let i = 0; i < here; i++) {
        left[start + done + i] = block[this.place++];
        right[start + done + i] = block[this.place++];
      }
      done += here;
      if (this.place === block.length) {
        this.blocks.shift();
        this.place = 0;
      }
    }
    this.waiting -= done;
    this.frame += done;
    return done;
  }

  /** Forget all but the last `keep` frames; how many went. */
  shorten(keep) {
    let gone = 0;
    while (this.blocks.length > 1 && this.waiting - (this.blocks[0].length - this.place) / 2 >= keep) {
      const frames = (this.blocks.shift().length - this.place) / 2;
      this.place = 0;
      this.waiting -= frames;
      this.frame += frames;
      gone += frames;
    }
    return gone;
  }
}

class PcmPlayer extends AudioWorkletProcessor {
  constructor() {
    super();
    this.queue = null;
    this.fading = null;
    this.fadeLeft = 0;
    this.chunk = new Float32Array(2 * REPORT_FRAMES);
    this.chunkLength = 0;
    this.chunkFrame = 0;
    this.chunkStream = 0;
    this.fadeBuffers = [new Float32Array(QUANTUM), new Float32Array(QUANTUM)];
    this.port.onmessage = ({ data }) => this.hear(data);
  }

  hear(data) {
    if (data.stop) this.retire();
    else if (data.end !== undefined) {
      if (this.queue?.stream === data.end) this.queue.ended = true;
    } else {
      if (this.queue?.stream !== data.stream) {
        this.retire();
        this.queue = new Queue(data.stream, data.frame);
      }
      this.queue.push(data.samples);
      if (this.queue.waiting > LONGEST_S * sampleRate) {
        this.report();
        this.port.postMessage({ dropped: this.queue.shorten(0.1 * sampleRate) });
      }
    }
  }

  /** Let the present stream fade. */
  retire() {
    this.report();
    if (this.queue?.flowing) {
      this.fading = this.queue;
      this.fadeLeft = FADE_FRAMES;
    }
    this.queue = null;
  }

  report() {
    if (!this.chunkLength) return;
    const samples = this.chunk.slice(0, 2 * this.chunkLength);
    this.port.postMessage({ played: this.chunkStream, frame: this.chunkFrame, samples }, [samples.buffer]);
    this.chunkLength = 0;
  }

  keep(left, right, count, stream, frame) {
    if (!this.chunkLength) {
      this.chunkStream = stream;
      this.chunkFrame = frame;
    }
    for (let i = 0; i < count; i++) {
      this.chunk[2 * this.chunkLength] = left[i];
      this.chunk[2 * this.chunkLength + 1] = right[i];
      if (++this.chunkLength === REPORT_FRAMES) {
        this.report();
        this.chunkStream = stream;
        this.chunkFrame = frame + i + 1;
      }
    }
  }

  process(inputs, [[left, right]]) {
    const { queue } = this;
    let done = 0;
    let first = 0;
    if (queue) {
      if (!queue.flowing) queue.flowing = queue.ended || queue.waiting >= CUSHIONS_S[queue.begun ? 1 : 0] * sampleRate;
      if (queue.flowing) {
        first = queue.frame;
        done = queue.take(left, right, 0, left.length);
        if (done && !queue.begun) {
          queue.begun = true;
          this.port.postMessage({ began: queue.stream, time: currentTime });
        }
        if (done < left.length) {
          queue.flowing = false;
          if (!queue.ended) this.port.postMessage({ starved: queue.stream, frame: queue.frame });
        }
      }
    }
    this.fade(left, right);
    if (done) this.keep(left, right, done, queue.stream, first);
    if (queue && !queue.flowing && this.chunkLength) this.report();
    return true;
  }

  fade(left, right) {
    if (!this.fading) return;
    const [l, r] = this.fadeBuffers;
    const count = this.fading.take(l, r, 0, Math.min(QUANTUM, left.length, this.fadeLeft));
    for (let i = 0; i < count; i++) {
      const share = 0.5 - 0.5 * Math.cos((Math.PI * (this.fadeLeft - i)) / FADE_FRAMES);
      left[i] += share * l[i];
      right[i] += share * r[i];
    }
    this.fadeLeft -= count;
    if (!count || this.fadeLeft <= 0) this.fading = null;
  }
}

registerProcessor("jawari-pcm", PcmPlayer);
