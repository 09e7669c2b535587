// playwasm.mjs MODULE BANK RATE FRAMES BLOCK EVENTS OUT: plays events with the engine as WebAssembly, as playtake.c does with a
// native library; `play` is for browsers too.

const EVENT_BYTES = 32;
const WHY_BYTES = 512;

/** FRAMES frames of two channels, interleaved. @returns {Float64Array} */
export function play(wasm, bank, rate, frames, block, events) {
  const x = new WebAssembly.Instance(new WebAssembly.Module(wasm), {}).exports;
  x._initialize();
  const bytes = (at, size) => new Uint8Array(x.memory.buffer, at, size);
  const why = x.jawari_alloc(WHY_BYTES);
  const told = (got) => {
    const text = bytes(why, WHY_BYTES);
    if (!got) throw new Error(String.fromCharCode(...text.subarray(0, text.indexOf(0))));
    return got;
  };
  const kept = x.jawari_alloc(bank.byteLength);
  bytes(kept, bank.byteLength).set(new Uint8Array(bank));
  const engine = told(x.jawari_create(told(x.jawari_open_bytes(kept, bank.byteLength, why)), rate, 1, why));
  const sides = [x.jawari_alloc(8 * block), x.jawari_alloc(8 * block)];
  const place = x.jawari_alloc(Math.max(1, events.byteLength));
  const sound = new Float64Array(2 * frames);
  for (let done = 0, first = 0; done < frames; done += block) {
    const n = Math.min(block, frames - done);
    const here = events.slice(first);
    const times = new DataView(here);
    let within = 0;
    for (let at = 0; at < here.byteLength && times.getBigInt64(at, true) < done + n; at += EVENT_BYTES, within += 1)
      times.setBigInt64(at, times.getBigInt64(at, true) - BigInt(done), true);
    bytes(place, here.byteLength).set(new Uint8Array(here));
    x.jawari_process(engine, place, within, n, ...sides);
    for (const [side, at] of sides.entries())
      new Float64Array(x.memory.buffer, at, n).forEach((value, i) => (sound[2 * (done + i) + side] = value));
    first += EVENT_BYTES * within;
  }
  return sound;
}

if (globalThis.process?.argv.length === 9) {
  const { readFileSync, writeFileSync } = await import("node:fs");
  const read = (path) => new Uint8Array(readFileSync(path)).buffer;
  const [module, bank, rate, frames, block, events, out] = process.argv.slice(2);
  const sound = play(read(module), read(bank), Number(rate), Number(frames), Number(block), read(events));
  writeFileSync(out, new Uint8Array(sound.buffer));
}
