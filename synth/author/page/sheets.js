// Dialogs and menus of the page's own kind: native dialogs, which close by Escape and give the focus back.

import { h } from "./format.js";

/** Show a sheet: title, content (elements), actions (buttons). Goes away when it is closed; gives the dialog. */
export function sheet(title, content, actions = [], { small = true, onclose = null } = {}) {
  const heading = h("h2", { class: "sheet-title" }, title);
  const close = h(
    "button",
    { type: "button", class: "icon sheet-close", "aria-label": "Close", onclick: () => dialog.close() },
    "×",
  );
  const dialog = h(
    "dialog",
    { class: small ? "sheet small" : "sheet", "aria-label": title },
    h("div", { class: "sheet-head" }, heading, close),
    ...content,
    actions.length ? h("div", { class: "sheet-actions" }, ...actions) : null,
  );
  // a click beside the sheet closes it
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) dialog.close();
  });
  dialog.addEventListener("close", () => {
    dialog.remove();
    onclose?.();
  });
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

/** A button that opens a menu of [label, action, {title, key, disabled()}] below it. */
export function menu(label, items, attributes = {}) {
  const list = h("div", { class: "menu", role: "menu", popover: "auto" });
  const button = h(
    "button",
    {
      type: "button",
      "aria-haspopup": "menu",
      "aria-expanded": "false",
      onclick: () => list.togglePopover(),
      ...attributes,
    },
    label,
  );
  const entries = items.map(([text, action, { title, key, disabled } = {}]) => ({
    disabled,
    element: h(
      "button",
      {
        type: "button",
        role: "menuitem",
        title,
        onclick: () => {
          list.hidePopover();
          action();
        },
      },
      h("span", {}, text),
      key ? h("kbd", {}, key) : null,
    ),
  }));
  list.append(...entries.map((entry) => entry.element));
  list.addEventListener("beforetoggle", ({ newState }) => {
    if (newState !== "open") return;
    for (const { element, disabled } of entries) element.disabled = disabled?.() ?? false;
  });
  list.addEventListener("toggle", ({ newState }) => {
    const open = newState === "open";
    button.setAttribute("aria-expanded", String(open));
    if (!open) return;
    const place = button.getBoundingClientRect();
    list.style.top = `${place.bottom + 4}px`;
    list.style.left = `${Math.max(8, Math.min(place.left, innerWidth - list.offsetWidth - 8))}px`;
    entries.find((entry) => !entry.element.disabled)?.element.focus();
  });
  list.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const usable = entries.map((entry) => entry.element).filter((one) => !one.disabled);
    usable.at((usable.indexOf(document.activeElement) + step) % usable.length)?.focus();
  });
  return h("span", { class: "menu-place" }, button, list);
}

const wanted = [];
let veil = null;

/** Files dropped anywhere on the page: the first that accept(file) wants goes to take(file). */
export function dropTarget(accept, take) {
  wanted.push({ accept, take });
  if (veil !== null) return;
  veil = h(
    "div",
    { class: "veil", hidden: true },
    h("p", {}, "Drop a preset (.toml) to import it, or a recording (.wav, .flac) to fit it"),
  );
  document.body.append(veil);
  const hasFiles = (event) => event.dataTransfer?.types.includes("Files");
  document.addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    veil.hidden = document.querySelector("dialog[open]") !== null;
  });
  document.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) veil.hidden = true;
  });
  document.addEventListener("drop", (event) => {
    veil.hidden = true;
    if (!hasFiles(event)) return;
    event.preventDefault();
    for (const file of event.dataTransfer.files) {
      const taker = wanted.find((one) => one.accept(file));
      if (taker) return taker.take(file);
    }
  });
}
