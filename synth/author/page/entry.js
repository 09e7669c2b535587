// Where numbers and texts are typed: what a field has sent, what it shows, what was refused.

import { FINE, makeKeys, onWheel } from "./fine.js";
import { h, plain } from "./format.js";
import { keyStep } from "./scale.js";
import { parseQuantity } from "./units.js";

/** Have a field show a text; one that is selected as a whole, to be typed over, stays so. */
export function showText(field, text) {
  if (field.value === text) return;
  const { value, selectionStart, selectionEnd } = field;
  const whole = field === document.activeElement && value !== "" && selectionStart === 0 && selectionEnd === value.length;
  field.value = text;
  if (whole) field.select();
}

/**
 * What a field has sent and has no answer to yet: it is not sent again (after Enter comes a change event) nor written over.
 * Then what is to be shown() is, unless it was refused or more is typed.
 */
export function makeSending(field, shown) {
  let text = null;
  return {
    get text() {
      return text;
    },
    send(what, answer) {
      text = what;
      const done = () => {
        if (text !== what) return;
        text = null;
        if (!field.hasAttribute("aria-invalid") && field.dataset.typing !== "yes") showText(field, shown());
      };
      answer.then(done, done);
    },
  };
}

/** A text field that takes numbers; `commit` gives a promise; arrows step it, Enter and leaving it commit, Escape gives up. */
export function numberInput(parameter, { commit, attributes = {} }) {
  const input = h("input", { type: "text", inputmode: "decimal", autocomplete: "off", spellcheck: "false", ...attributes });
  let shown = "";
  const sending = makeSending(input, () => shown);
  const keys = makeKeys();
  const refused = (reason) => {
    input.setAttribute("aria-invalid", "true");
    input.setCustomValidity(reason);
    input.title = reason;
  };
  const settle = () => {
    delete input.dataset.typing;
    input.removeAttribute("aria-invalid");
    input.setCustomValidity("");
    input.title = "";
  };
  const send = (merge) => {
    const text = input.value.trim();
    if (text === (sending.text ?? shown)) {
      settle();
      commit(undefined, null, null);
      return;
    }
    const away = text === "" && parameter.optional;
    const { value, reason } = away ? { value: null } : parseQuantity(text, parameter.unit);
    if (reason !== undefined) {
      refused(reason);
      commit(undefined, null, reason);
      return;
    }
    settle();
    sending.send(text, commit(value, away ? null : merge));
  };
  input.addEventListener("input", () => {
    input.dataset.typing = "yes";
  });
  input.addEventListener("change", () => send(null));
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") send(null);
    if (event.key === "Escape") {
      input.value = shown;
      settle();
      commit(undefined, null, null);
    }
    if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
    if (step(event.key === "ArrowUp" ? 1 : -1, event.shiftKey)) event.preventDefault();
  });
  onWheel(input, (notches, event) => step(notches, event.shiftKey));

  /** So many steps up, finer ones with Shift; false where there is no number to step from. */
  function step(count, fine) {
    const { value, reason } = parseQuantity(input.value, parameter.unit);
    if (reason !== undefined) return false;
    const size = keyStep(value, parameter) * (fine && !parameter.integer ? FINE : 1);
    input.value = plain(Math.min(parameter.maximum ?? Infinity, Math.max(parameter.minimum ?? -Infinity, value + count * size)));
    send(`arrows ${attributes["data-part"]} ${keys.following()}`);
    return true;
  }

  return {
    input,
    update(value, invalid) {
      const typing = input.dataset.typing === "yes" && document.activeElement === input;
      const before = shown;
      shown = plain(value);
      // what was refused stays in the field, to be put right
      const kept = invalid && before === shown && input.value !== shown;
      if (!typing && !kept && sending.text === null) showText(input, shown);
      if (invalid) input.setAttribute("aria-invalid", "true");
      else if (!typing) settle();
    },
  };
}
