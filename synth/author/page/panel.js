// A drawing surface to scale: metres along, millimetres up, each with its own stretch, and the rulers of both.
//
//   const panel = makePanel("name", "what it shows", rulers);
//   panel.frame({x0, x1, y0, y1});       // what is shown; panel.X(m), panel.Y(mm) → px, panel.x(px), panel.y(px) back
//   rulers: {up(view, count), along(view, count)} -> {unit, ticks: [[coordinate, text, main] …]}, of other things than lengths
//   panel.back, panel.front, panel.handles, panel.lights: SVG groups, from behind to the front

import { number, s } from "./format.js";

const MARGIN = { left: 46, right: 18, top: 16, bottom: 30 };

/** Rulers of a thing to scale: heights in mm, or µm where it is small, lengths in mm. */
const LENGTHS = {
  up(view, count) {
    const micro = view.y1 - view.y0 < 0.4;
    const unit = micro ? 1000 : 1;
    const ticks = nice(view.y0 * unit, view.y1 * unit, count).map((tick) => [tick / unit, number(tick), tick === 0]);
    return { unit: micro ? "µm" : "mm", ticks };
  },
  along: (view, count) => ({ unit: "", ticks: nice(1000 * view.x0, 1000 * view.x1, count).map((tick) => [tick / 1000, number(tick), false]) }),
};

export function makePanel(name, label, scales = LENGTHS) {
  const rulers = s("g", { class: "rulers" });
  const back = s("g", { class: "back" });
  const front = s("g", { class: "front" });
  const handles = s("g", { class: "handles" });
  const lights = s("g", { class: "lights" });
  const clip = s("clipPath", { id: `clip-${name}` }, s("rect"));
  const scene = s("g", { "clip-path": `url(#clip-${name})` }, back, front);
  const svg = s("svg", { class: `stage-${name}`, role: "group", "aria-label": label }, s("defs", {}, clip), rulers, scene, handles, lights);
  let size = { width: 600, height: 240 };
  let view = { x0: 0, x1: 1, y0: -1, y1: 1 };

  const panel = {
    svg,
    back,
    front,
    handles,
    lights,
    X: (x) => MARGIN.left + ((x - view.x0) / (view.x1 - view.x0)) * (size.width - MARGIN.left - MARGIN.right),
    Y: (h) => MARGIN.top + ((view.y1 - h) / (view.y1 - view.y0)) * (size.height - MARGIN.top - MARGIN.bottom),
    x: (px) => view.x0 + ((px - MARGIN.left) / (size.width - MARGIN.left - MARGIN.right)) * (view.x1 - view.x0),
    y: (px) => view.y1 - ((px - MARGIN.top) / (size.height - MARGIN.top - MARGIN.bottom)) * (view.y1 - view.y0),
    get view() {
      return view;
    },
    get size() {
      return size;
    },
    get bottom() {
      return size.height - MARGIN.bottom;
    },
    /** How many times longer a height is drawn than a length. */
    stretch() {
      const up = (size.height - MARGIN.top - MARGIN.bottom) / (view.y1 - view.y0);
      const along = (size.width - MARGIN.left - MARGIN.right) / (1000 * (view.x1 - view.x0));
      return up / along;
    },
    line: (points) => points.map(([x, h]) => `${panel.X(x).toFixed(2)},${panel.Y(h).toFixed(2)}`).join(" "),
    shows: (x) => x >= view.x0 && x <= view.x1,
    /** Take the element's size; true where it has changed. */
    measure() {
      const { width, height } = svg.getBoundingClientRect();
      if (width < 50 || height < 50 || (width === size.width && height === size.height)) return false;
      size = { width, height };
      return true;
    },
    frame(wanted) {
      view = wanted;
      svg.setAttribute("viewBox", `0 0 ${size.width} ${size.height}`);
      const inside = clip.firstChild;
      inside.setAttribute("x", MARGIN.left - 6);
      inside.setAttribute("y", 0);
      inside.setAttribute("width", size.width - MARGIN.left - MARGIN.right + 12);
      inside.setAttribute("height", panel.bottom + 1);
      rulers.replaceChildren(...up(), ...along());
    },
  };

  function up() {
    const { unit, ticks } = scales.up(view, Math.max(3, Math.floor(size.height / 44)));
    const grid = ticks.flatMap(([tick, text, main]) => {
      const y = panel.Y(tick);
      return [
        s("line", { class: main ? "grid zero" : "grid", x1: MARGIN.left, x2: size.width - MARGIN.right, y1: y, y2: y }),
        s("text", { class: "tick", x: MARGIN.left - 7, y: y + 3.5, "text-anchor": "end" }, text),
      ];
    });
    return [...grid, s("text", { class: "tick", x: MARGIN.left - 7, y: MARGIN.top - 6, "text-anchor": "end" }, unit)];
  }

  function along() {
    const { unit, ticks } = scales.along(view, Math.max(3, Math.floor(size.width / 80)));
    const y = size.height - MARGIN.bottom;
    const marks = ticks.flatMap(([tick, text]) => {
      const x = panel.X(tick);
      return [
        s("line", { class: "ruler", x1: x, x2: x, y1: y + 1, y2: y + 6 }),
        s("text", { class: "tick", x, y: y + 18, "text-anchor": "middle" }, text),
      ];
    });
    const end = size.width - MARGIN.right;
    const name = unit === "" ? [] : [s("text", { class: "tick", x: end, y: y - 5, "text-anchor": "end" }, unit)];
    return [s("line", { class: "ruler", x1: MARGIN.left, x2: end, y1: y, y2: y }), ...marks, ...name];
  }

  return panel;
}

/** Round numbers between two ends, about `count` of them. */
export function nice(low, high, count) {
  const raw = (high - low) / count;
  const digit = 10 ** Math.floor(Math.log10(raw));
  const step = digit * ([1, 2, 5, 10].find((lead) => lead * digit >= raw) ?? 10);
  const out = [];
  for (let i = Math.ceil(low / step); i * step <= high + 1e-9 * step; i += 1) out.push(Number((i * step).toPrecision(12)));
  return out;
}
