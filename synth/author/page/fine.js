// Moving by hand, as everywhere on the page: Shift moves ten times finer, by drag, wheel and arrow keys; the wheel moves what
// has the focus and lies under the pointer, else it scrolls the page; a double click goes back.
//
//   const hand = refine(input, {place(), move(place, {key, fine}), reset(key), step, least, rest()});
//   hand.held()      // it is being dragged: what comes meanwhile must not move it
//
// input: of type range; places are what its min and max are in. move takes a place within them; changes with the same `key`
// belong together. step: how far an arrow key or a notch of the wheel moves; least: the finest step there is; rest is called
// when a drag has ended.

/** Ten times finer with Shift. */
export const FINE = 0.1;
/** Steps that follow each other within this time belong together. */
export const PAUSE_MS = 1000;
const DOUBLE_MS = 500;
const PAGE_STEPS = 10;
const THUMB_PX = 14;
/** Pixels of a wheel without notches that are as far as one notch. */
const NOTCH_PX = 100;
const NOTCH_LINES = 3;

/** Numbers for what belongs together: next() where something new begins, following() where it may go on. */
export function makeKeys() {
  let key = 0;
  let last = -Infinity;
  return {
    next: () => (key += 1),
    following() {
      if (performance.now() - last > PAUSE_MS) key += 1;
      last = performance.now();
      return key;
    },
  };
}

/** Call turn(notches, event) for the wheel over an element that has the focus; elsewhere it is the page's. */
export function onWheel(element, turn) {
  let turned = 0;
  const wheel = (event) => {
    if (event.ctrlKey || event.metaKey) return; // the browser's zoom
    event.preventDefault();
    // with Shift many browsers turn the wheel sideways
    const delta = event.deltaY || event.deltaX;
    turned -= delta / (event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? NOTCH_PX : NOTCH_LINES);
    const notches = Math.abs(turned) < 1 ? 0 : Math.trunc(turned);
    turned -= notches;
    if (notches !== 0) turn(notches, event);
  };
  // no listener, so nothing for the page's scrolling to wait for, but while it has the focus
  element.addEventListener("focus", () => {
    turned = 0;
    element.addEventListener("wheel", wheel, { passive: false });
  });
  element.addEventListener("blur", () => element.removeEventListener("wheel", wheel));
}

export function refine(input, { place, move, reset, step, least = 0, rest = () => {} }) {
  const keys = makeKeys();
  let key = 0;
  let held = false;
  let drag = null;
  let down = -Infinity;

  const low = () => Number(input.min);
  const high = () => Number(input.max);
  const go = (wanted, fine) => move(Math.min(high(), Math.max(low(), wanted)), { key, fine });
  const by = (steps, fine) => {
    key = keys.following();
    go(place() + steps * (fine ? Math.max(least, FINE * step) : step), fine);
  };

  const room = () => {
    const { left, width } = input.getBoundingClientRect();
    return { left: left + THUMB_PX / 2, width: Math.max(1, width - THUMB_PX) };
  };

  input.addEventListener("pointerdown", (event) => {
    held = true;
    if (event.timeStamp - down > DOUBLE_MS) key = keys.next(); // of a double click, both belong together
    down = event.timeStamp;
    // fingers have no Shift: theirs is the browser's own way
    if (event.pointerType === "touch" || event.button !== 0 || input.matches(":disabled")) return;
    event.preventDefault();
    input.focus({ preventScroll: true });
    input.setPointerCapture(event.pointerId);
    const { left, width } = room();
    const thumb = left + (width * (place() - low())) / (high() - low());
    const at = low() + ((event.clientX - left) / width) * (high() - low());
    drag = { x: event.clientX, at: place() };
    if (event.shiftKey || Math.abs(event.clientX - thumb) <= THUMB_PX / 2) return;
    drag.at = at;
    go(at, false);
  });
  // where the browser drags all the same
  input.addEventListener("mousedown", (event) => drag !== null && event.preventDefault());
  input.addEventListener("pointermove", (event) => {
    if (drag === null) return;
    const way = ((event.clientX - drag.x) / room().width) * (high() - low());
    if (way === 0) return;
    drag.x = event.clientX;
    drag.at += way * (event.shiftKey ? FINE : 1);
    go(drag.at, event.shiftKey);
  });
  const end = () => {
    drag = null;
    if (!held) return;
    held = false;
    rest();
  };
  for (const type of ["pointerup", "pointercancel", "lostpointercapture", "change", "blur"]) input.addEventListener(type, end);
  input.addEventListener("input", () => {
    if (!held) key = keys.following();
    go(Number(input.value), false);
  });
  input.addEventListener("dblclick", (event) => {
    event.preventDefault();
    end();
    reset(key);
  });
  input.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: PAGE_STEPS, PageDown: -PAGE_STEPS }[event.key];
    if (steps !== undefined) by(steps, event.shiftKey);
    else if (event.key === "Home" || event.key === "End") {
      key = keys.following();
      go(event.key === "Home" ? low() : high(), false);
    } else return;
    event.preventDefault();
  });
  onWheel(input, (notches, event) => by(notches, event.shiftKey));
  return { held: () => held };
}
