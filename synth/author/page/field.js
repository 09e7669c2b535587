// One control: its name with the physics as a tip, slider, exact entry with unit, mark and way back, reason of a refusal.
//
//   const field = makeField(parameter, context);   // parameter as GET …/parameters describes it
//   field.element; field.update(value, {saved, error})
//
// context: {store, parameterOf(path), commit(path, value, mergeKey), commitMany(changes, mergeKey), refuse(path, reason)}.
// What is typed is sent on Enter or when the field is left; `refuse` shows a reason without asking the server.

import { makeAnchors } from "./anchors.js";
import { wayBack } from "./edits.js";
import { makeSending, numberInput, showText } from "./entry.js";
import { refine } from "./fine.js";
import { h, number, noteName, parseNote, plain, same } from "./format.js";
import { makeNumbers } from "./numbers.js";
import { makeScale, STEPS, travelFor } from "./scale.js";
import { hiddenTip } from "./tip.js";

/** A slider's arrow key or notch of the wheel moves it by a hundredth of its travel. */
const SLIDER_STEP = STEPS / 100;

let fields = 0;

export function makeField(parameter, context) {
  const { path, label, unit, tip } = parameter;
  const id = `control-${(fields += 1)}`;
  const name = h("button", { type: "button", class: "control-name", "data-tip": tip, "data-tip-tap": true, id: `${id}-name` }, label);
  const mark = h("span", { class: "control-mark", "aria-hidden": "true" });
  const back = h("button", { type: "button", class: "icon control-back", "data-part": "back" }, "↺");
  const error = h("p", { class: "control-error", id: `${id}-error`, role: "alert", hidden: true });
  const labels = { "aria-labelledby": `${id}-name`, "aria-describedby": `${id}-tip ${id}-error` };
  let way = null;
  const goBack = (merge = null) => way && context.commit(path, way.value, merge);
  const body = makeBody(parameter, { ...context, labels, goBack });
  const head = h("div", { class: "control-head" }, mark, name, h("span", { class: "control-entry" }, ...body.entry), back);
  const element = h(
    "div",
    { class: `control kind-${parameter.kind}`, "data-path": path, "data-stop": true, role: "group", "aria-labelledby": `${id}-name` },
    head,
    ...body.below,
    error,
    hiddenTip(`${id}-tip`, unit ? `${tip} In ${unit}.` : tip),
  );
  back.addEventListener("click", () => goBack());

  return {
    element,
    parameter,
    /** A reason stands at it. */
    refused: () => !error.hidden,
    update(value, { saved, error: reason }) {
      const changed = !same(value, saved);
      way = wayBack(parameter, value, saved);
      back.hidden = way === null;
      if (way !== null) {
        back.classList.toggle("to-saved", way.toSaved);
        back.title = `Back to ${way.toSaved ? "saved" : "default"}: ${brief(way.target)}`;
        back.setAttribute("aria-label", `${label}: ${back.title.toLowerCase()}`);
      }
      mark.classList.toggle("changed", changed);
      mark.title = changed ? `Saved: ${brief(saved)}` : "";
      element.classList.toggle("changed", changed);
      element.classList.toggle("unset", value === null || value === undefined);
      error.hidden = !reason;
      error.textContent = reason ?? "";
      body.update(value, Boolean(reason));
    },
  };
}

/** A value in a few words. */
function brief(value) {
  if (value === null || value === undefined) return "not given";
  if (typeof value === "number") return number(value);
  if (Array.isArray(value)) return `${value.length} values`;
  if (typeof value === "object") return "by note";
  return String(value) || "empty";
}

function makeBody(parameter, context) {
  switch (parameter.kind) {
    case "number":
      return makeNumber(parameter, context);
    case "anchored":
      return makeAnchors(parameter, context, makeNumber(parameter, context));
    case "choice":
      return makeChoice(parameter, context);
    case "flag":
      return makeFlag(parameter, context);
    case "notes":
      return makeText(parameter, context, showNotes, readNotes);
    case "list":
      if (parameter.item === "number") return makeNumbers(parameter, context);
      return makeText(parameter, context);
    default:
      return makeText(parameter, context);
  }
}

function makeNumber(parameter, { commit, refuse, labels, goBack }) {
  const { path, unit } = parameter;
  const entry = numberInput(parameter, {
    commit: (value, merge, reason) => (value === undefined ? refuse(path, reason) : commit(path, value, merge && `${merge} ${path}`)),
    attributes: { class: "control-number", "data-part": "number", placeholder: "–", ...labels },
  });
  const below = [];
  let slider = null;
  let hand = null;
  let scale = null;
  let at = 0;
  let wanted = [null, false];
  let sent = 0;
  const travel = parameter.travel ?? parameter.usual ?? [parameter.minimum, parameter.maximum];
  if (travel.every(Number.isFinite)) {
    slider = h("input", { type: "range", min: 0, max: STEPS, step: "any", class: "control-slider", "data-part": "slider", ...labels });
    hand = refine(slider, {
      place: () => at,
      move(place, { key, fine }) {
        const value = scale.value(place, fine);
        entry.input.value = plain(value);
        slide(value);
        follow(commit(path, value, `slider ${path} ${key}`));
      },
      reset: (key) => follow(goBack(`slider ${path} ${key}`)),
      step: SLIDER_STEP,
      // whole numbers have no finer step
      least: parameter.integer ? STEPS / (travel[1] - travel[0]) : 0,
      rest: () => show(),
    });
    below.push(slider);
  }

  /** Until the last answer is there, the slider stays where the hand has put it. */
  function follow(answer) {
    sent += 1;
    const mine = sent;
    Promise.resolve(answer).finally(() => {
      if (mine !== sent) return;
      sent = 0;
      show();
    });
  }

  const slide = (value) => {
    at = scale.place(value);
    slider.value = at;
    slider.style.setProperty("--at", `${(100 * at) / STEPS}%`);
    slider.setAttribute("aria-valuetext", `${number(value)} ${unit ?? ""}`.trim());
  };

  function show() {
    if (hand?.held() || sent > 0) return;
    const [value, invalid] = wanted;
    entry.update(value, invalid);
    if (slider === null) return;
    const given = typeof value === "number";
    const place = given ? value : typeof parameter.suggested === "number" ? parameter.suggested : travel[0];
    // a value at an end of what is usual, or beyond, widens the slider's travel
    scale = makeScale({ ...parameter, ...(given ? travelFor(parameter, travel, place) : { minimum: Math.min(travel[0], place), maximum: Math.max(travel[1], place) }) });
    slider.classList.toggle("unset", !given);
    slide(place);
    if (!given) slider.setAttribute("aria-valuetext", "not given");
  }

  return {
    entry: [entry.input, h("span", { class: "unit" }, unit ?? "")],
    below,
    update(value, invalid) {
      wanted = [value, invalid];
      show();
    },
  };
}

function makeChoice(parameter, { commitMany, labels }) {
  const select = h("select", { "data-part": "choice", ...labels });
  for (const { value, label } of parameter.choices) select.append(h("option", { value }, label));
  select.addEventListener("change", () => commitMany(parameter.choices.find(({ value }) => value === select.value).edits));
  return {
    entry: [select],
    below: [],
    update(value) {
      select.value = value ?? "";
    },
  };
}

function makeFlag(parameter, { commit, labels }) {
  const { path } = parameter;
  const box = h("input", { type: "checkbox", role: "switch", "data-part": "flag", ...labels });
  box.addEventListener("change", () => commit(path, box.checked, null));
  return {
    entry: [box],
    below: [],
    update(value) {
      box.checked = Boolean(value);
    },
  };
}

function makeText(parameter, { commit, refuse, labels }, show = (value) => value ?? "", read = (text) => text) {
  const { path } = parameter;
  const many = parameter.item === "text";
  const long = parameter.multiline || many;
  const box = long
    ? h("textarea", { rows: path === "remarks" ? 7 : 3, "data-part": "text", ...labels })
    : h("input", { type: "text", autocomplete: "off", "data-part": "text", class: "control-text", ...labels });
  const shownAs = (value) => (many ? (value ?? []).join("\n") : show(value));
  let shown = "";
  const sending = makeSending(box, () => shown);
  const send = () => {
    if (box.value === (sending.text ?? shown)) return;
    delete box.dataset.typing;
    const value = many ? box.value.split("\n").filter((line) => line.trim() !== "") : read(box.value);
    if (value === undefined) refuse(path, `“${box.value}” is not a note or a range; write one such as G2 or E1-C7`);
    else sending.send(box.value, commit(path, value, null));
  };
  box.addEventListener("input", () => {
    box.dataset.typing = "yes";
  });
  box.addEventListener("change", send);
  box.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && !long) send();
    if (event.key === "Escape") {
      box.value = shown;
      delete box.dataset.typing;
    }
  });
  return {
    entry: long ? [] : [box],
    below: long ? [box] : [],
    update(value, invalid) {
      const before = shown;
      shown = shownAs(value);
      const typing = box.dataset.typing === "yes" && document.activeElement === box;
      if (!typing && !(invalid && before === shown) && sending.text === null) showText(box, shown);
      if (invalid) box.setAttribute("aria-invalid", "true");
      else box.removeAttribute("aria-invalid");
    },
  };
}

function showNotes(value) {
  if (!Array.isArray(value)) return value ?? "";
  const [low, high] = value.map(noteName);
  return low === high ? low : `${low}–${high}`;
}

/** "G2", "E1-C7": as the file writes it; undefined where it is none. */
function readNotes(text) {
  const ends = text.split(/\s*[–]\s*|(?<=\d)\s*-\s*/).map(parseNote);
  if (ends.length > 2 || ends.includes(null)) return undefined;
  return ends.map((note) => noteName(note).replace("♯", "#")).join("-");
}
