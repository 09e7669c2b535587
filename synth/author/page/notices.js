// Short lines at the edge, read aloud by screen readers: news go after a while, errors stay until they are closed.

import { h } from "./format.js";

const SECONDS = 6;
const MOST = 4;

export function mount(element, { store }) {
  store.onNotice(({ text, kind }) => {
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
