// The audio contexts of a page: one that answers keys at once, and one that lets the audio thread compute farther ahead, for
// instruments that need most of a block's time.

/** The sample rate of banks for pages [Hz]. */
export const RATE_HZ = 48000;
/** What the browser is asked for: its shortest latency, or this one [s]. */
const HINTS = { quick: "interactive", ample: 0.025 };

const contexts = new Map();

/** @param {"quick" | "ample"} kind */
export function contextOf(kind) {
  if (!contexts.has(kind)) contexts.set(kind, { context: made(HINTS[kind]), modules: new Map() });
  return contexts.get(kind).context;
}

function made(latencyHint) {
  if (!globalThis.AudioContext || !globalThis.AudioWorkletNode)
    throw new Error(
      globalThis.isSecureContext === false
        ? "browsers play instruments only over https: or from this machine (http://localhost)"
        : "this browser has no AudioWorklet, by which the strings are computed; a newer one has it",
    );
  let context;
  try {
    context = new AudioContext({ sampleRate: RATE_HZ, latencyHint });
  } catch (error) {
    throw new Error(`this browser plays no sound at ${RATE_HZ} Hz, for which the instrument was made: ${error.message}`);
  }
  if (context.sampleRate !== RATE_HZ)
    throw new Error(`this browser plays at ${context.sampleRate} Hz only, and the instrument was made for ${RATE_HZ} Hz`);
  return context;
}

/** The program of the audio thread in a context, once. */
export function programIn(kind, worklet) {
  const context = contextOf(kind);
  const { modules } = contexts.get(kind);
  if (!modules.has(worklet))
    modules.set(
      worklet,
      context.audioWorklet.addModule(worklet).catch((error) => {
        modules.delete(worklet);
        throw new Error(`the program of the audio thread does not come: ${worklet}: ${error.message}`);
      }),
    );
  return modules.get(worklet);
}
