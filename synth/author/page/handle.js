// Things of the drawing that can be dragged, by mouse, touch or arrow keys. Each is a slider to assistive technology.
//
//   const handles = makeHandles(panel, {edit(changes, mergeKey), valueOf(path), backOf(path), busy(bool)});
//   handles.show([{id, x, y, label, row, drag: {x: D|null, height: D|null}, shape: SVGElement[]}]);
//
// Handles of a `row` (the frets) are one stop of Tab: left and right arrow go from one to the next, up and down move it.
//
// Of others only those whose spec has no `stop: false` are stops of Tab; `chosen` and `past` change how they look.
//
// x [m], y [mm] are the place; D is as GET …/instrument describes it: value = offset + factor · coordinate, or e to that where
// D is `exponential`. A drag moves
// along one axis, the one in which it begins; all of it is one step of undo. Shift moves ten times finer, Page up and down
// ten times further than an arrow key; a double click puts the thing back, to what backOf(path) says ({value}, or null).

import { FINE, makeKeys } from "./fine.js";
import { number, s } from "./format.js";

const DEAD_PX = 4;
const REACH_PX = matchMedia("(pointer: coarse)").matches ? 22 : 14;
/** An arrow key moves by so much of what is shown. */
const KEY_SHARE = 0.004;
const PAGE_STEPS = 10;

export function makeHandles(panel, { edit, valueOf: presentOf, backOf, busy }) {
  const known = new Map();
  const readout = s("g", { class: "readout", "aria-hidden": "true" }, s("rect", { rx: 4 }), s("text"));
  readout.setAttribute("visibility", "hidden");
  let drags = 0;
  let held = null;

  function show(wanted) {
    const ids = new Set(wanted.map(({ id }) => id));
    for (const [id, handle] of known) {
      if (ids.has(id) || handle === held) continue;
      handle.element.remove();
      known.delete(id);
    }
    let before = null;
    for (const spec of wanted) {
      let handle = known.get(spec.id);
      if (handle === undefined) {
        handle = make(spec.id);
        known.set(spec.id, handle);
      }
      handle.take(spec);
      if (handle.element.parentNode === null || (before !== null && handle.element.previousSibling !== before)) {
        const focused = document.activeElement === handle.element;
        if (before === null) panel.handles.prepend(handle.element);
        else before.after(handle.element);
        if (focused) handle.element.focus();
      }
      before = handle.element;
    }
    panel.handles.append(readout);
    const stops = rowOf();
    const stop = stops.find(({ element }) => element === document.activeElement) ?? stops.find(({ element }) => element.tabIndex === 0);
    for (const each of stops) each.element.tabIndex = each === (stop ?? stops[0]) ? 0 : -1;
    for (const handle of known.values()) if (document.activeElement === handle.element && held === null) say(handle);
  }

  const rowOf = () => [...known.values()].filter(({ spec }) => spec.row).sort((a, b) => a.spec.x - b.spec.x);

  function make(id) {
    const reach = s("circle", { class: "reach", r: REACH_PX });
    const shape = s("g", { class: "shape" });
    const element = s("g", { class: "handle", tabindex: 0, role: "slider", "data-handle": id }, reach, shape);
    const handle = { element, spec: null, take };
    let start = null;
    let shown = "";
    const keys = makeKeys();

    function take(spec) {
      if (held === handle) {
        // the server's place of what is being dragged comes late: the hand leads
        handle.spec = { ...spec, x: handle.spec.x, y: handle.spec.y, drag: handle.spec.drag };
        return;
      }
      handle.spec = spec;
      // what looks as before stays: under a hand that clicks, a new element would be another
      const looks = spec.shape.map((each) => each.outerHTML).join("");
      if (looks !== shown) shape.replaceChildren(...spec.shape);
      shown = looks;
      element.setAttribute("aria-label", spec.label);
      element.classList.toggle("past", Boolean(spec.past));
      element.classList.toggle("chosen", Boolean(spec.chosen));
      if (!spec.row) element.tabIndex = spec.stop === false ? -1 : 0;
      place();
    }

    function place() {
      const { x, y, drag } = handle.spec;
      element.setAttribute("transform", `translate(${panel.X(x).toFixed(2)} ${panel.Y(y).toFixed(2)})`);
      const first = drag.x ?? drag.height;
      const value = current(handle, drag.x ? "x" : "height");
      element.setAttribute("aria-valuenow", Number(value.toPrecision(5)));
      if (first.minimum !== null) element.setAttribute("aria-valuemin", first.minimum);
      if (first.maximum !== null) element.setAttribute("aria-valuemax", first.maximum);
      element.setAttribute("aria-orientation", drag.x ? "horizontal" : "vertical");
      element.setAttribute("aria-valuetext", words(handle));
      element.classList.toggle("both", Boolean(drag.x && drag.height));
    }

    /** Move to a coordinate on one axis: the handle at once, the preset as fast as the server follows. */
    function move(axis, coordinate, key, fine) {
      const d = handle.spec.drag[axis];
      const value = clamp(valueOf(d, coordinate), d);
      const settled = coordinateOf(d, value);
      handle.spec = { ...handle.spec, ...(axis === "x" ? { x: settled } : { y: settled }) };
      place();
      say(handle);
      const digits = Number(value.toPrecision(fine ? 5 : 4));
      const whole = d.anchor === null ? digits : { ...presentOf(d.path), [d.anchor]: digits };
      edit([...d.edits, { path: d.path, value: whole }], key);
    }

    element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      element.focus({ preventScroll: true });
      element.setPointerCapture(event.pointerId);
      drags += 1;
      held = handle;
      start = { px: event.clientX, py: event.clientY, x: handle.spec.x, y: handle.spec.y, axis: null, way: 0, before: 0 };
      element.classList.add("held");
      busy(true);
      say(handle);
    });
    element.addEventListener("pointermove", (event) => {
      if (start === null) return;
      const dx = event.clientX - start.px;
      const dy = event.clientY - start.py;
      const { drag } = handle.spec;
      if (start.axis === null) {
        if (Math.hypot(dx, dy) < DEAD_PX) return;
        start.axis = drag.x && (!drag.height || Math.abs(dx) >= Math.abs(dy)) ? "x" : "height";
      }
      // where Shift comes or goes on the way, the thing stays under the hand
      const fine = event.shiftKey;
      const along = start.axis === "x" ? dx : dy;
      start.way += (along - start.before) * (fine ? FINE : 1);
      start.before = along;
      if (start.axis === "x") move("x", panel.x(panel.X(start.x) + start.way), `drag ${id} ${drags}`, fine);
      else move("height", panel.y(panel.Y(start.y) + start.way), `drag ${id} ${drags}`, fine);
    });
    const end = () => {
      if (start === null) return;
      start = null;
      held = null;
      element.classList.remove("held");
      busy(false);
    };
    element.addEventListener("pointerup", end);
    element.addEventListener("pointercancel", end);
    element.addEventListener("lostpointercapture", end);

    element.addEventListener("dblclick", (event) => {
      event.preventDefault();
      const paths = [...new Set([handle.spec.drag.x, handle.spec.drag.height].filter(Boolean).map(({ path }) => path))];
      const changes = paths.map((path) => ({ path, back: backOf(path) })).filter(({ back }) => back !== null);
      if (changes.length > 0) edit(changes.map(({ path, back }) => ({ path, value: back.value })), null);
    });

    element.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowUp: ["height", 1], ArrowDown: ["height", -1], PageUp: ["height", PAGE_STEPS], PageDown: ["height", -PAGE_STEPS] }[event.key];
      if (way === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
      const { drag } = handle.spec;
      if (handle.spec.row && way[0] === "x") {
        event.preventDefault();
        const row = rowOf();
        const next = row[row.indexOf(handle) + way[1]];
        next?.element.focus();
        return;
      }
      // what moves along one axis only takes both pairs of arrows
      const axis = drag[way[0]] ? way[0] : drag.x ? "x" : "height";
      event.preventDefault();
      const { view } = panel;
      const span = axis === "x" ? view.x1 - view.x0 : view.y1 - view.y0;
      const from = axis === "x" ? handle.spec.x : handle.spec.y;
      const step = KEY_SHARE * span * (event.shiftKey ? FINE : 1);
      move(axis, from + way[1] * step, `keys ${id} ${axis} ${keys.following()}`, event.shiftKey);
    });
    element.addEventListener("focus", () => {
      if (!handle.spec.row) return;
      for (const each of rowOf()) each.element.tabIndex = each === handle ? 0 : -1;
    });
    for (const on of ["focus", "pointerenter"]) element.addEventListener(on, () => held === null && say(handle));
    for (const off of ["blur", "pointerleave"]) element.addEventListener(off, () => held === null && hush());
    return handle;
  }

  function say(handle) {
    const text = readout.lastChild;
    text.textContent = `${handle.spec.label}: ${words(handle)}`;
    readout.setAttribute("visibility", "visible");
    const { width } = text.getBBox();
    const x = Math.min(panel.size.width - width - 14, Math.max(6, panel.X(handle.spec.x) - width / 2));
    const above = panel.Y(handle.spec.y) - 40;
    const y = above < 4 ? panel.Y(handle.spec.y) + 22 : above;
    const box = readout.firstChild;
    for (const [name, value] of Object.entries({ x: x - 7, y, width: width + 14, height: 21 })) box.setAttribute(name, value);
    text.setAttribute("x", x);
    text.setAttribute("y", y + 14.5);
  }

  const hush = () => readout.setAttribute("visibility", "hidden");

  return { show, dragging: () => held !== null };
}

function clamp(value, { minimum, maximum }) {
  return Math.min(maximum ?? Infinity, Math.max(minimum ?? -Infinity, value));
}

function current({ spec }, axis) {
  const d = spec.drag[axis];
  return valueOf(d, axis === "x" ? spec.x : spec.y);
}

function valueOf(d, coordinate) {
  const linear = d.offset + d.factor * coordinate;
  return d.exponential ? Math.exp(linear) : linear;
}

function coordinateOf(d, value) {
  return ((d.exponential ? Math.log(value) : value) - d.offset) / d.factor;
}

const UNITS = [
  [/_mm(\.\d+)?$/, "mm"],
  [/_um$/, "µm"],
  [/(position|position_hard|distance_ratio)$/, "of L"],
  [/_hz$/, "Hz"],
  [/_kg$/, "kg"],
  [/\.q$/, "(Q)"],
];

function words(handle) {
  return ["x", "height"]
    .filter((axis) => handle.spec.drag[axis])
    .map((axis) => {
      const unit = UNITS.find(([ending]) => ending.test(handle.spec.drag[axis].path))?.[1] ?? "";
      return `${number(current(handle, axis), 3)} ${unit}`;
    })
    .join(", ");
}
