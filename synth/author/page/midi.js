// MIDI keyboards through the browser (Web MIDI), where it has them.

const NOTE_OFF = 0x80;
const NOTE_ON = 0x90;
const CONTROL = 0xb0;
const BEND = 0xe0;
const SUSTAIN = 64;

/** A MIDI message as the server's: an object, or null for what is not played. */
export function translate(bytes) {
  const [status, first, second] = bytes;
  switch (status & 0xf0) {
    case NOTE_ON:
      return second > 0 ? { type: "note_on", key: first, velocity: second } : { type: "note_off", key: first };
    case NOTE_OFF:
      return { type: "note_off", key: first };
    case CONTROL:
      return first === SUSTAIN
        ? { type: "pedal", down: second >= 64 }
        : { type: "control", controller: first, value: second };
    case BEND:
      return { type: "bend", value: first + 128 * second - 8192 };
    default:
      return null;
  }
}

/** Why there is no MIDI, in words, from what requestMIDIAccess threw. */
export function refusal(error) {
  if (error.name === "NotAllowedError" || error.name === "SecurityError")
    return "The browser does not allow MIDI for this page";
  if (error.name === "InvalidStateError" || error.name === "NotSupportedError") return "This system has no MIDI";
  return `MIDI: ${error.message}`;
}

/**
 * Listen to every input, one plugged in later too.
 *
 * play(message) gets what was played, report(text, inputs) how it stands: names of inputs, or why there is none (null).
 */
export async function connectMidi(play, report) {
  if (!navigator.requestMIDIAccess) {
    report("This browser has no MIDI", null);
    return;
  }
  let access;
  try {
    access = await navigator.requestMIDIAccess();
  } catch (error) {
    report(refusal(error), null);
    return;
  }
  const look = () => {
    const inputs = [...access.inputs.values()].filter((input) => input.state === "connected");
    for (const input of inputs) {
      input.onmidimessage = ({ data }) => {
        const message = translate(data);
        if (message) play(message);
      };
    }
    report(inputs.length ? inputs.map((input) => input.name).join(", ") : "No MIDI keyboard is connected", inputs.length);
  };
  access.onstatechange = look;
  look();
}

/** Whether the page may use MIDI without asking. */
export async function midiGranted() {
  try {
    return (await navigator.permissions.query({ name: "midi" })).state === "granted";
  } catch {
    return false;
  }
}
