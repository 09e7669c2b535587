// Before a document is open: the presets that there are.

import { makeBrowser } from "./browse.js";
import { h } from "./format.js";
import { where } from "./presets.js";

export function mount(element, { store, api }) {
  const builtIn = h("section", { class: "cards-browser", "aria-label": "Built in" });
  let browser = null;
  store.on(["session"], async ({ session, doc }) => {
    element.replaceChildren();
    if (session === null) return;
    const own = session.presets.filter((preset) => !preset.embedded);
    const cards = own.map((preset) =>
      h(
        "li",
        {},
        h(
          "button",
          {
            type: "button",
            "data-preset": preset.name,
            disabled: preset.reason !== null,
            onclick: () => store.open(preset),
          },
          h("span", { class: "title" }, preset.title || preset.name),
          h("span", { class: "where" }, where(preset)),
        ),
      ),
    );
    element.append(
      h("h2", {}, "Which instrument?"),
      h("p", {}, "Open a preset to see its strings, hear them and shape them. Built-in presets are never overwritten."),
      cards.length ? h("ul", { class: "cards" }, ...cards) : "",
      builtIn,
    );
    if (browser !== null || doc !== null) return;
    browser = await makeBrowser({ store, api, open: (preset) => (browser.silence(), store.open(preset)) });
    builtIn.append(browser.element);
  });
}
