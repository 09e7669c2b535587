// The keys of a computer as those of a piano, by their places, whatever letters are on them.

const ROWS = ["KeyA", "KeyW", "KeyS", "KeyE", "KeyD", "KeyF", "KeyT", "KeyG", "KeyY", "KeyH", "KeyU", "KeyJ", "KeyK", "KeyO", "KeyL", "KeyP", "Semicolon"];
const SEMITONES = new Map(ROWS.map((code, semitone) => [code, semitone]));
const LOWER = "KeyZ";
const HIGHER = "KeyX";
const VELOCITY = 90;

/** Whether keys are typed into something. */
const writes = (target) => target.closest?.("textarea, select, input:not([type=range]), [contenteditable]");

/**
 * @param {import("./keyboard.js").Keyboard} keyboard
 * @param {() => boolean} heard whether the keys are this instrument's
 * @returns {() => void} ends it
 */
export function playByTyping(keyboard, heard) {
  const down = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || !heard()) return;
    if (writes(event.composedPath()[0])) return;
    if (event.code === LOWER) keyboard.shift(-12);
    else if (event.code === HIGHER) keyboard.shift(12);
    else if (SEMITONES.has(event.code)) {
      const first = keyboard.first - (keyboard.first % 12); // A is a C
      const note = first + SEMITONES.get(event.code) + (first < keyboard.lowest - 6 ? 12 : 0);
      keyboard.hold(event.code, note, VELOCITY);
    } else return;
    event.preventDefault();
  };
  const up = (event) => keyboard.letGo(event.code);
  window.addEventListener("keydown", down);
  window.addEventListener("keyup", up);
  return () => {
    window.removeEventListener("keydown", down);
    window.removeEventListener("keyup", up);
  };
}
