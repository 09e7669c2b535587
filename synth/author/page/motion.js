// The string in slow motion over the drawing: play, time slider with the contact force over time, speed, which moment.
// Points that are touched light up, with a bar as long as the force. Time counts from the moment the finger lets go.

import { refine } from "./fine.js";
import { h, number, s } from "./format.js";
import { latest } from "./latest.js";

const FRAMES = 300;
/** How many periods of the note a film shows. */
const PERIODS = 4;
const SPEEDS = [50, 100, 200, 500, 1000, 2000];
const MOMENTS = [
  [0, "from the release"],
  [0.1, "after 0.1 s"],
  [0.3, "after 0.3 s"],
  [1, "after 1 s"],
  [2, "after 2 s"],
];
/** A film of the release begins so much before it. */
const LEAD_S = 0.0015;
const BAR_PX = 46;
const STRIP = { width: 1000, height: 24 };
const SETTLE_MS = 350;
/** Frames that an arrow key goes on. */
const SLIDER_STEP = 3;

const PLAY = "M6 3.5v13l10.5-6.5z";
const PAUSE = "M6 4h3v12H6zM11.5 4h3v12h-3z";

/** watch(film, at): told of what is shown, a frame and what lies between two; (null, 0) where it is the still drawing. */
export function mount(element, { store, panels, redraw, watch }) {
  const icon = s("path", { class: "fill", d: PLAY });
  const play = h("button", { type: "button", class: "icon play", id: "film-play", "aria-label": "Play in slow motion" }, s("svg", { viewBox: "0 0 20 20" }, icon));
  const strip = s("svg", { class: "strip", viewBox: `0 0 ${STRIP.width} ${STRIP.height}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const slider = h("input", { type: "range", min: 0, max: FRAMES - 1, step: "any", value: 0, id: "film-time", "aria-label": "Time in the film" });
  const time = h("output", { class: "film-time", for: "film-time" }, "slow motion");
  const force = h("output", { class: "film-force" });
  const speed = h("select", { id: "film-speed", "aria-label": "Slowed down by" }, ...SPEEDS.map((x) => h("option", { value: x }, `1/${x}`)));
  const moment = h("select", { id: "film-moment", "aria-label": "Moment" }, ...MOMENTS.map(([x, name]) => h("option", { value: x }, name)));
  speed.value = 500;
  element.append(play, h("div", { class: "film-slider" }, strip, slider), h("div", { class: "film-side" }, time, force, moment, speed));

  const marks = Object.fromEntries(Object.keys(panels).map((name) => [name, makeMarks(panels[name])]));
  let film = null;
  let shown = false; // the still drawing stands until the film is played or its time is moved
  let at = 0;
  let playing = false;
  let clock = 0;
  let settle = 0;

  const load = latest(async () => {
    const { doc, note, velocity, which } = store.state;
    if (doc === null) return;
    element.classList.add("waiting");
    try {
      const seconds = Number((PERIODS / frequency(note)).toPrecision(3));
      const start = Math.max(0, drawSeconds(note) - LEAD_S) + Number(moment.value);
      const found = await store.view("motion", { note, velocity, which, seconds, frames: FRAMES, start_s: start });
      take(found);
    } catch (error) {
      film = null;
      stop();
      store.notify(error.message, "error");
    } finally {
      element.classList.remove("waiting");
    }
  });

  /** How long the finger draws the string aside at a note. */
  function drawSeconds(note) {
    const given = store.value("pluck.draw_ms");
    if (typeof given === "number") return given / 1000;
    const notes = Object.keys(given).map(Number);
    const nearest = notes.reduce((best, one) => (Math.abs(one - note) < Math.abs(best - note) ? one : best));
    return given[nearest] / 1000;
  }

  function take(found) {
    film = { ...found, total: found.force.map((points) => points.reduce((sum, newton) => sum + newton, 0)) };
    slider.max = found.frames.length - 1;
    at = Math.min(at, found.frames.length - 1);
    drawStrip();
    redraw();
  }

  function drawStrip() {
    const most = Math.max(...film.total, 1e-12);
    const step = STRIP.width / (film.total.length - 1);
    const points = film.total.map((now, i) => `${(i * step).toFixed(1)},${(STRIP.height - (STRIP.height - 2) * Math.sqrt(now / most)).toFixed(1)}`);
    strip.replaceChildren(s("polygon", { points: `0,${STRIP.height} ${points.join(" ")} ${STRIP.width},${STRIP.height}` }));
  }

  function draw() {
    if (film === null || !shown) {
      for (const mark of Object.values(marks)) mark.hide();
      watch(null, 0);
      return;
    }
    const first = Math.floor(at);
    const second = Math.min(first + 1, film.frames.length - 1);
    const part = at - first;
    const line = film.x.map((x, i) => [x, film.frames[first][i] + part * (film.frames[second][i] - film.frames[first][i])]);
    // a frame's force is the largest since the frame before it
    const forces = Math.ceil(at);
    // what rides on a bridge that moves is where the bridge is
    const lift = film.rides ? film.lift[first] + part * (film.lift[second] - film.lift[first]) : 0;
    const touched = film.points.map(({ x, height }, i) => ({ x, height: height + lift, newton: film.force[forces][i] }));
    const finger = film.finger[first] === null ? null : [film.finger_x, film.finger[first]];
    for (const mark of Object.values(marks)) mark.show(line, touched, film.largest_n, finger, lift);
    watch(film, at);
    const ms = 1000 * (film.start_s + at * film.dt_s - film.release_s);
    time.textContent = `${ms.toFixed(2).replace("-", "−")} ms`;
    const sum = film.total[forces];
    force.textContent = sum > 0 ? `${number(sum, 2)} N` : "free";
    force.classList.toggle("lit", sum > 0);
    slider.value = at;
    slider.setAttribute("aria-valuetext", `${time.textContent}, ${sum > 0 ? `contact ${number(sum, 2)} newton` : "no contact"}`);
    slider.style.setProperty("--at", `${(100 * at) / (film.frames.length - 1)}%`);
  }

  function tick(now) {
    if (!playing) return;
    if (film !== null) {
      const passed = Math.min(0.1, Math.max(0, now - clock) / 1000);
      at += passed / Number(speed.value) / film.dt_s;
      const last = film.frames.length - 1;
      if (at > last) at %= last;
      draw();
    }
    clock = now;
    requestAnimationFrame(tick);
  }

  function start() {
    shown = true;
    playing = true;
    redraw();
    clock = performance.now();
    icon.setAttribute("d", PAUSE);
    play.setAttribute("aria-label", "Pause");
    element.classList.add("playing");
    if (film === null) load();
    requestAnimationFrame(tick);
  }

  function stop() {
    playing = false;
    icon.setAttribute("d", PLAY);
    play.setAttribute("aria-label", "Play in slow motion");
    element.classList.remove("playing");
  }

  play.addEventListener("click", () => (playing ? stop() : start()));
  function go(place) {
    stop();
    at = place;
    if (!shown) {
      shown = true;
      redraw();
    }
    if (film === null) load();
    else draw();
  }
  refine(slider, { place: () => at, move: go, reset: () => go(0), step: SLIDER_STEP });
  moment.addEventListener("change", () => {
    shown = true;
    load();
  });
  // a film of what is no more is not shown; it comes anew once the hand rests
  store.on(["doc", "note", "velocity", "which"], () => {
    clearTimeout(settle);
    settle = setTimeout(load, SETTLE_MS);
  });
  store.on(["note", "which"], () => {
    film = null;
    draw();
  });

  return { draw, film: () => (shown ? film : null) };
}

const frequency = (note) => 440 * 2 ** ((note - 69) / 12);

/** The moving string, the lit points and the bars of force of one panel. */
function makeMarks(panel) {
  const string = s("polyline", { class: "string-moving" });
  const finger = s("circle", { class: "finger", r: 7 });
  const group = s("g", { class: "motion" }, string, finger);
  const lifted = (lift) => {
    for (const each of panel.back.querySelectorAll(".rides")) {
      if (lift === 0) each.removeAttribute("transform");
      else each.setAttribute("transform", `translate(0 ${(panel.Y(lift) - panel.Y(0)).toFixed(2)})`);
    }
  };
  return {
    hide() {
      group.remove();
      panel.lights.replaceChildren();
      panel.svg.classList.remove("moving");
      lifted(0);
    },
    show(line, touched, peak, hand, lift) {
      lifted(lift);
      if (group.parentNode !== panel.front) panel.front.append(group);
      panel.svg.classList.add("moving");
      string.setAttribute("points", panel.line(line));
      finger.setAttribute("visibility", hand !== null && panel.shows(hand[0]) ? "visible" : "hidden");
      if (hand !== null) {
        finger.setAttribute("cx", panel.X(hand[0]));
        finger.setAttribute("cy", panel.Y(hand[1]) + 8);
      }
      panel.lights.replaceChildren(
        ...touched
          .filter(({ x, newton }) => newton > 0 && panel.shows(x))
          .flatMap(({ x, height, newton }) => {
            const px = panel.X(x);
            const py = panel.Y(height);
            const long = BAR_PX * Math.sqrt(newton / peak);
            return [
              s("line", { class: "force", x1: px, x2: px, y1: py + 5, y2: py + 5 + long }),
              s("circle", { class: "light", cx: px, cy: py, r: 4.5 }),
            ];
          }),
      );
    },
  };
}
