// Bridge and body that strings share: the modes as peaks over the bridge's mobility, to be dragged, added and taken away; what
// was measured laid over it; the bridge and the strings on it, which move with the film. Where strings end in nothing that
// moves: a body to begin with.
//
//   const { show } = mount(element, {store, api});   // show(film, at) as motion.js watches it

import { makeBridge } from "./bridge.js";
import { hertz, seconds } from "./figure.js";
import { h, number, s } from "./format.js";
import { makeHandles } from "./handle.js";
import { latest } from "./latest.js";
import { makeMoving } from "./moving.js";
import { makePanel, nice } from "./panel.js";

const AXES = { normal: "up and down", lateral: "along the body", rocking: "rocking" };
const DIGITS = [1, 2, 5];
const MARGIN_DB = 6;
/** A mode that does not move this way lies so far above the bottom. */
const ASIDE_DB = 4;
const LEAST_DB = 30;
/** Half as far as a mode's reed swings, and where they stand, from the bottom [px]. */
const REED_PX = 16;
const REED_FOOT_PX = 22;

const decades = {
  up: (view, count) => ({ unit: "dB", ticks: nice(view.y0, view.y1, count).map((tick) => [tick, number(tick), false]) }),
  along(view) {
    const ticks = [];
    for (let power = 1; power <= 1e5; power *= 10) {
      for (const digit of DIGITS) {
        const at = Math.log(digit * power);
        if (at >= view.x0 && at <= view.x1) ticks.push([at, number(digit * power), false]);
      }
    }
    return { unit: "Hz", ticks };
  },
};

export function mount(element, { store, api }) {
  const panel = makePanel("mobility", "Mobility of the bridge: a peak for each mode of the body", decades);
  const bridge = makeBridge();
  const caption = h("figcaption");
  const option = (value, name) => h("option", { value }, name);
  const axis = h("select", { id: "body-axis", "aria-label": "Motion of the bridge" });
  const upward = h("select", { id: "body-upward", "aria-label": "Up and down changes" }, option("q", "height is Q"), option("mass", "height is mass"));
  const chosen = h("select", { id: "body-mode", "aria-label": "Mode" });
  const add = h("button", { type: "button", class: "quiet small", id: "body-add" }, "+ mode");
  const away = h("button", { type: "button", class: "quiet small", id: "body-away" }, "remove");
  const file = h("input", { type: "file", accept: ".csv,.txt,.tsv,text/csv,text/plain", class: "hidden-text", id: "body-file", tabindex: -1, "aria-hidden": "true" });
  const lay = h("button", { type: "button", class: "quiet small", id: "body-measured" }, "Measured…");
  lay.title = "Overlay a measured mobility from a table in the format of synth body fit";
  const facts = h("dl", { class: "facts body-facts", id: "body-facts" });
  const tools = h("div", { class: "body-tools", role: "group", "aria-label": "Modes of the body" }, chosen, add, away, axis, upward, lay, file, facts);
  const stages = h("div", { class: "stages body-stages" }, h("figure", { class: "stage mobility" }, caption, panel.svg), bridge.element);
  const begin = h("button", { type: "button", id: "body-begin" }, "Add a body");
  const said = h("p", { class: "muted" }, "The ends of each string are rigid. With a body, the strings share a bridge: they beat and ring with each other.");
  const none = h("div", { class: "body-none" }, said, begin);
  element.append(tools, stages, none);
  element.hidden = true;

  let body = null;
  let ghost = null;
  let ghostKey = "";
  let measured = null;
  let hand = false;
  let mode = 0;
  let focusOn = null; // a mode that gets the focus as soon as it is drawn
  let film = null;
  let at = 0;
  let listed = "";

  const handles = makeHandles(panel, makeMoving(store, { held: (now) => (hand = now), redraw: draw }));

  const ask = latest(async () => {
    const { doc, which } = store.state;
    if (doc === null) return;
    let found;
    try {
      found = await store.view("body", { which });
    } catch (error) {
      store.notify(error.message, "error");
      return;
    }
    body = found;
    element.hidden = false;
    tools.hidden = stages.hidden = !body.coupled;
    none.hidden = body.coupled;
    begin.disabled = which === "saved";
    if (!body.coupled) return;
    const form = JSON.stringify(body.strings);
    if (form !== listed) {
      listed = form;
      bridge.take(body.strings);
    }
    if (focusOn === null || focusOn < body.modes.length) mode = Math.min(focusOn ?? mode, body.modes.length - 1);
    list();
    draw();
    await askGhost();
  });

  async function askGhost() {
    const { doc, which } = store.state;
    const now = which === "current" ? doc.data.body : null;
    const key = doc.dirty && now !== null && JSON.stringify(now) !== JSON.stringify(doc.saved.body) ? JSON.stringify([doc.doc, doc.saved.body]) : "";
    if (key === ghostKey) return;
    ghostKey = key;
    ghost = key === "" ? null : await store.view("body", { which: "saved" }).catch(() => null);
    if (ghost !== null && !ghost.coupled) ghost = null;
    draw();
  }

  /** The choices of mode and axis as they now are. */
  function list() {
    const names = body.modes.map(({ frequency_hz: hz }, i) => `Mode ${i + 1}: ${hertz(hz)}`);
    if ([...chosen.options].map(({ text }) => text).join() !== names.join()) chosen.replaceChildren(...names.map((name, i) => option(i, name)));
    chosen.value = mode;
    const kept = axis.value;
    if (axis.options.length !== body.axes.length) axis.replaceChildren(...body.axes.map((name, i) => option(i, AXES[name])));
    axis.value = kept !== "" && Number(kept) < body.axes.length ? kept : 0;
    axis.hidden = body.axes.length === 1;
    const locked = store.state.which === "saved";
    add.disabled = locked;
    away.disabled = locked || body.modes.length < 2;
    away.title = body.modes.length < 2 ? "A body needs at least one mode; undo removes the body" : "";
  }

  const direction = () => Number(axis.value || 0);
  const curve = ({ hz, mobility_db: db }) => hz.map((one, i) => [Math.log(one), db[direction()][i]]);

  function view() {
    const db = body.mobility_db[direction()];
    const lines = [...db, ...(measured?.axes[body.axes[direction()]] ?? [])];
    const top = Math.max(...lines) + MARGIN_DB;
    const bottom = Math.min(top - LEAST_DB, Math.max(top - 90, Math.min(...lines)) - 2 * MARGIN_DB);
    return { x0: Math.log(body.hz[0]), x1: Math.log(body.hz.at(-1)), y0: bottom, y1: top };
  }

  function draw() {
    if (body === null || !body.coupled) return;
    panel.measure();
    if (!hand) panel.frame(view());
    const front = [];
    const over = measured?.axes[body.axes[direction()]];
    if (over) front.push(s("polyline", { class: "measured", points: panel.line(measured.hz.map((hz, i) => [Math.log(hz), over[i]])) }));
    if (ghost !== null && direction() < ghost.axes.length) front.push(s("polyline", { class: "ghost", points: panel.line(curve(ghost)) }));
    front.push(s("polyline", { class: "mobility-curve", points: panel.line(curve(body)) }));
    panel.front.replaceChildren(...front);
    handles.show(store.state.which === "saved" ? [] : body.modes.map(handleOf));
    const wanted = focusOn === null ? null : panel.svg.querySelector(`[data-handle="mode-${focusOn}"]`);
    if (wanted !== null && focusOn < body.modes.length) {
      focusOn = null;
      wanted.focus();
    }
    const missing = measured !== null && !over ? `; ${measured.name} has no data for it` : "";
    caption.textContent = `Mobility of the bridge, ${AXES[body.axes[direction()]]}, without strings${over ? `, and ${measured.name}` : missing}`;
    tell();
    reeds();
  }

  function handleOf({ index, frequency_hz: hz, peak_db: peaks, drag }) {
    const moves = peaks[direction()] !== null;
    return {
      id: `mode-${index}`,
      x: Math.log(hz),
      y: moves ? Math.min(panel.view.y1, Math.max(panel.view.y0 + ASIDE_DB, peaks[direction()])) : panel.view.y0 + ASIDE_DB,
      label: `Mode ${index + 1}`,
      stop: index === mode,
      past: !moves,
      drag: { x: drag.frequency, height: drag[upward.value][direction()] },
      chosen: index === mode,
      shape: [s("circle", { class: "knob", r: 5 })],
    };
  }

  function tell() {
    const { frequency_hz: hz, q, mass_kg: mass, rings_s: rings, peak_db: peaks } = body.modes[mode];
    const fact = (name, value, unit) => h("div", {}, h("dt", {}, name), h("dd", {}, value, h("span", { class: "unit" }, unit && ` ${unit}`)));
    const peak = peaks[direction()];
    facts.replaceChildren(
      fact("f", number(hz, 4), "Hz"),
      fact("Q", number(q, 3), ""),
      fact("mass", number(mass, 3), "kg"),
      fact("T60", seconds(rings), ""),
      fact("peak", peak === null ? "–" : number(peak, 3), peak === null ? "" : "dB"),
    );
  }

  /** Each mode's motion at the film's time, where it stands in frequency. */
  function reeds() {
    if (body === null || !body.coupled || film === null || film.body?.motion[0].length !== body.modes.length || !(film.body.largest > 0)) {
      panel.lights.replaceChildren();
      return;
    }
    const first = Math.floor(at);
    const second = Math.min(first + 1, film.frames.length - 1);
    const { motion, largest } = film.body;
    const y = panel.bottom - REED_FOOT_PX;
    panel.lights.replaceChildren(
      ...body.modes.flatMap(({ frequency_hz: hz }, i) => {
        const x = panel.X(Math.log(hz));
        const up = (REED_PX * (motion[first][i] + (at - first) * (motion[second][i] - motion[first][i]))) / largest;
        return [
          s("line", { class: "reed", x1: x, x2: x, y1: y, y2: y - up }),
          s("circle", { class: "reed-end", cx: x, cy: y - up, r: 2.5 }),
        ];
      }),
    );
  }

  function show(now, frame) {
    const still = film === null && now === null;
    film = now;
    at = frame;
    if (still || body === null || !body.coupled) return;
    bridge.show(film, at);
    reeds();
  }

  function choose(index) {
    if (index === mode) return;
    mode = index;
    list();
    draw();
  }

  chosen.addEventListener("change", () => choose(Number(chosen.value)));
  axis.addEventListener("change", draw);
  upward.addEventListener("change", draw);
  const numberOf = (event) => {
    const id = event.target.closest("[data-handle]")?.dataset.handle;
    return id === undefined ? null : Number(id.slice("mode-".length));
  };
  panel.svg.addEventListener("focusin", (event) => numberOf(event) !== null && choose(numberOf(event)));
  panel.svg.addEventListener("keydown", (event) => {
    if (event.key !== "Delete" || numberOf(event) === null || away.disabled) return;
    event.preventDefault();
    remove();
  });

  async function remove() {
    // the keyboard goes on at a neighbour
    const focused = panel.svg.contains(document.activeElement);
    const count = body.modes.length - 1;
    if ((await store.edit(`body.mode.${mode}`, null)) === null) return;
    if (focused) focusOn = Math.min(mode, count - 1);
    ask();
  }

  add.addEventListener("click", async () => {
    const index = body.modes.length;
    if ((await store.edit(`body.mode.${index}`, body.new)) === null) return;
    focusOn = index;
    ask();
  });
  away.addEventListener("click", remove);

  begin.addEventListener("click", async () => {
    begin.disabled = true;
    try {
      const found = await store.view("begin-body");
      if (found.edits !== null && (await store.editMany(found.edits)) !== null) store.notify(found.said);
      else if (found.edits === null) store.notify(found.said, "error");
    } catch (error) {
      store.notify(error.message, "error");
    } finally {
      begin.disabled = store.state.which === "saved";
    }
  });

  lay.addEventListener("click", () => {
    if (measured === null) file.click();
    else {
      measured = null;
      lay.textContent = "Measured…";
      draw();
    }
  });
  file.addEventListener("change", async () => {
    const [table] = file.files;
    file.value = "";
    if (table === undefined) return;
    try {
      measured = await api.post(`/api/mobility?${new URLSearchParams({ name: table.name })}`, table);
      lay.textContent = `without ${table.name}`;
      draw();
    } catch (error) {
      store.notify(error.message, "error");
    }
  });

  store.on(["doc", "which"], ask);
  new ResizeObserver(draw).observe(panel.svg);
  return { show };
}
