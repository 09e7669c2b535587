// How long blocks take, for a page that asks (`?measure`).

/** Milliseconds, as finely as the audio thread can tell them: some browsers have whole ones there only. */
export const clock = globalThis.performance?.now ? () => performance.now() : () => Date.now();

export class Measure {
  constructor() {
    this.clear(Infinity);
  }

  /** room: how far behind the audio thread may be before nothing is left to be heard [ms]. */
  clear(room) {
    this.room = room;
    this.behind = 0;
    this.blocks = this.late = this.missed = this.total = this.worst = this.peak = this.sounded = 0;
  }

  /** A block that took so long [ms]; it has `quantum` [ms] of time. */
  block(took, quantum, left, right) {
    this.blocks++;
    this.total += took;
    if (took > quantum) this.late++;
    const before = this.behind;
    this.behind = Math.max(before + took - quantum, 0);
    if (this.behind > this.room && before <= this.room) this.missed++;
    if (took > this.worst) this.worst = took;
    for (let k = 0; k < left.length; k++) this.peak = Math.max(this.peak, Math.abs(left[k]), Math.abs(right[k]));
    if (!this.sounded && this.peak > 1e-4) this.sounded = Date.now();
    this.quantum = quantum;
  }

  figures() {
    const { blocks, late, missed, worst, peak, sounded } = this;
    return { blocks, late, missed, worst_ms: worst, peak, sounded, load: blocks ? this.total / (blocks * this.quantum) : 0 };
  }
}
