// Before a document is open: the presets that there are.

import { h } from "./format.js";
import { where } from "./presets.js";

export function mount(element, { store }) {
  store.on(["session"], ({ session }) => {
    element.replaceChildren();
    if (session === null) return;
    const cards = session.presets.map((preset) =>
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
      h("p", {}, "Open a preset to see its strings, hear them and shape them. What comes with the program is never written over."),
      h("ul", { class: "cards" }, ...cards),
    );
  });
}
