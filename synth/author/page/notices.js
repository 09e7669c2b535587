// Short lines at the edge, read aloud by screen readers: news go after a while, errors stay until they are closed. What is
// said while a dialog is open stands over it, and goes with it.

import { h } from "./format.js";

const SECONDS = 6;
const MOST = 4;

/** The place for notices in a dialog, which covers the page's. */
function within(dialog) {
  const known = dialog.querySelector(":scope > .notices");
  if (known !== null) return known;
  const place = h("div", { class: "notices", role: "status", "aria-live": "polite" });
  dialog.addEventListener("close", () => place.remove(), { once: true });
  dialog.append(place);
  return place;
}

export function mount(page, { store }) {
  store.onNotice(({ text, kind }) => {
    const dialog = [...document.querySelectorAll("dialog[open]")].at(-1);
    const element = dialog === undefined ? page : within(dialog);
    for (const old of element.children) {
      if (old.firstChild.textContent === text) old.remove();
    }
    const notice = h("div", { class: `notice ${kind}` }, h("span", {}, text));
    const close = h("button", { type: "button", class: "icon", "aria-label": "Close", onclick: () => notice.remove() }, "×");
    notice.append(close);
    element.append(notice);
    while (element.children.length > MOST) element.firstChild.remove();
    if (kind !== "error") setTimeout(() => notice.remove(), 1000 * SECONDS);
  });
}
