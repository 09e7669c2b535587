// Elements of a page.

/**
 * @param {string} tag
 * @param {Object<string, unknown>} [given] attributes; functions are listeners, "text" is what stands in it
 * @param {...Node} children
 */
export function element(tag, given = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(given)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (name === "text") made.textContent = value;
    else if (value !== false && value !== undefined) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/** A switch: a button that is pressed or not. change(on) is told. */
export function toggle(text, change, given = {}) {
  const made = element("button", {
    type: "button",
    "aria-pressed": "false",
    text,
    click: () => {
      set(made.getAttribute("aria-pressed") !== "true");
      change(made.getAttribute("aria-pressed") === "true");
    },
    ...given,
  });
  const set = (on) => made.setAttribute("aria-pressed", String(on));
  return { element: made, set };
}
