// The presets that come with the program, by family: search, families and tags to choose from, a few seconds of each to hear.
//
//   const browser = await makeBrowser({store, api, open});   // open(preset): what happens with the one that is chosen
//   browser.element, browser.search                          // the whole, and the field in it
//   browser.silence()                                        // no more sound
//
// By keyboard: arrow down leaves the field for the list, up and down go through it, left and right between a preset and its
// sound; Tab goes from the field to the families, the tags and the list.

import { h } from "./format.js";
import { toolbar } from "./roving.js";

const OTHERS = "other";
const MOST_TAGS = 18;

export async function makeBrowser({ store, api, open }) {
  const presets = await api.get("/api/presets").catch((error) => {
    store.notify(error.message, "error");
    return [];
  });
  const sound = makeSound(store);
  const families = [...new Set(presets.map((preset) => preset.family || OTHERS))];
  const tags = mostCommon(presets.flatMap((preset) => preset.tags)).slice(0, MOST_TAGS);
  let family = null;
  const chosen = new Set();

  const search = h("input", {
    type: "search",
    class: "browse-search",
    placeholder: "Name, family or tag",
    "aria-label": "Find a preset",
    autocomplete: "off",
    spellcheck: "false",
    oninput: show,
  });
  const familyButtons = families.map((name) => {
    const toggle = () => {
      family = family === name ? null : name;
      for (const each of familyButtons) each.setAttribute("aria-pressed", String(each.dataset.family === family));
      show();
    };
    return h("button", { type: "button", class: "chip", "data-family": name, "aria-pressed": "false", onclick: toggle }, name);
  });
  const tagButtons = tags.map((tag) => {
    const toggle = () => {
      if (!chosen.delete(tag)) chosen.add(tag);
      button.setAttribute("aria-pressed", String(chosen.has(tag)));
      show();
    };
    const button = h("button", { type: "button", class: "chip quiet", "data-tag": tag, "aria-pressed": "false", onclick: toggle }, tag);
    return button;
  });
  const familyBar = h("div", { class: "chips", role: "toolbar", "aria-label": "Families" }, ...familyButtons);
  const tagBar = h("div", { class: "chips", role: "toolbar", "aria-label": "Tags" }, ...tagButtons);
  const rows = new Map(presets.map((preset) => [preset.name, makeRow(preset, { sound, open })]));
  const list = h("div", { class: "browse-list" });
  const said = h("p", { class: "muted browse-count", role: "status" });
  const element = h("div", { class: "browse" }, search, familyBar, tagBar, said, list);
  if (families.length > 1) toolbar(familyBar);
  if (tags.length > 1) toolbar(tagBar);

  const fits = (preset) => {
    const words = search.value.trim().toLowerCase().split(/\s+/);
    const text = [preset.name, preset.title, preset.family, preset.description, ...preset.tags].join(" ").toLowerCase();
    return (
      (family === null || (preset.family || OTHERS) === family) &&
      [...chosen].every((tag) => preset.tags.includes(tag)) &&
      words.every((word) => text.includes(word))
    );
  };

  function show() {
    const left = presets.filter(fits);
    const groups = families
      .map((name) => [name, left.filter((preset) => (preset.family || OTHERS) === name)])
      .filter(([, some]) => some.length > 0);
    list.replaceChildren(
      ...groups.map(([name, some]) =>
        h(
          "section",
          { "aria-label": name },
          h("h4", { class: "browse-family" }, name),
          h("ul", { class: "browse-rows" }, ...some.map((preset) => rows.get(preset.name))),
        ),
      ),
    );
    said.textContent =
      left.length === presets.length ? `${presets.length} presets` : left.length ? `${left.length} of ${presets.length}` : "No preset matches; remove a word or a tag";
    oneStop();
  }

  // ---- arrows in the list, which is one stop of Tab
  const shown = () => [...list.querySelectorAll("[data-preset]")];
  let current = null;

  function oneStop() {
    const all = shown();
    if (!all.includes(current)) current = all[0] ?? null;
    for (const each of all) {
      each.tabIndex = each === current ? 0 : -1;
      each.parentElement.querySelector("[data-listen]").tabIndex = each === current ? 0 : -1;
    }
  }

  list.addEventListener("focusin", ({ target }) => {
    current = target.closest("li")?.querySelector("[data-preset]") ?? current;
    oneStop();
  });
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
    const all = shown();
    const row = event.target.closest("li");
    if (event.target === search && event.key === "ArrowDown" && all.length) {
      event.preventDefault();
      all[0].focus();
    }
    if (row === null || !list.contains(row)) return;
    const part = event.target.matches("[data-listen]") ? "[data-listen]" : "[data-preset]";
    const step = { ArrowDown: 1, ArrowUp: -1, Home: -Infinity, End: Infinity }[event.key];
    if (step !== undefined) {
      event.preventDefault();
      const at = all.indexOf(row.querySelector("[data-preset]")) + step;
      if (at < 0 && step === -1) return search.focus();
      const next = all[Math.max(0, Math.min(all.length - 1, at))].parentElement.querySelector(part);
      next.focus();
      next.scrollIntoView({ block: "nearest" });
    }
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      event.preventDefault();
      row.querySelector(part === "[data-listen]" ? "[data-preset]" : "[data-listen]").focus();
    }
  });

  show();
  return { element, search, silence: sound.stop };
}

function makeRow(preset, { sound, open }) {
  const listen = h("button", { type: "button", class: "icon listen", "data-listen": preset.name, "data-state": "idle" });
  const say = (state) => {
    listen.dataset.state = state;
    const words = { idle: `Listen to ${preset.title}`, waiting: `${preset.title} is being prepared; stop`, playing: `Stop ${preset.title}` };
    listen.setAttribute("aria-label", words[state]);
    listen.textContent = { idle: "▶", waiting: "…", playing: "■" }[state];
  };
  say("idle");
  listen.addEventListener("click", () => (listen.dataset.state === "idle" ? sound.play(preset.name, say) : sound.stop()));
  const [low, high] = preset.range.map((note) => note.replace("#", "♯"));
  return h(
    "li",
    {},
    listen,
    h(
      "button",
      { type: "button", class: "quiet browse-open", "data-preset": preset.name, onclick: () => open({ ...preset, embedded: true, file: null }) },
      h("span", { class: "browse-title" }, preset.title || preset.name, h("span", { class: "unit" }, low === high ? low : `${low}–${high}`)),
      h("span", { class: "browse-about" }, preset.description),
      h("span", { class: "browse-tags" }, preset.tags.join(" · ")),
    ),
  );
}

/** One sound at a time: play(name, say) tells by say("waiting" | "playing" | "idle") how it stands. */
function makeSound(store) {
  let playing = null;

  function stop() {
    const before = playing;
    playing = null;
    before?.audio.pause();
    before?.audio.removeAttribute("src");
    before?.say("idle");
  }

  function play(name, say) {
    stop();
    const audio = new Audio(`/api/presets/${encodeURIComponent(name)}/sample.wav`);
    const mine = { audio, say };
    playing = mine;
    const ended = () => playing === mine && stop();
    audio.addEventListener("playing", () => playing === mine && say("playing"));
    audio.addEventListener("ended", ended);
    audio.addEventListener("error", () => {
      if (playing !== mine) return;
      stop();
      store.notify(`${name} cannot be played: ${audio.error?.message || "no sound arrived"}`, "error");
    });
    say("waiting");
    audio.play().catch(ended);
  }

  return { play, stop };
}

/** Each once, the most frequent first, equally frequent ones by name. */
function mostCommon(words) {
  const counts = new Map();
  for (const word of words) counts.set(word, (counts.get(word) ?? 0) + 1);
  return [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a) || a.localeCompare(b));
}
