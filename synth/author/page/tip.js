// One tooltip for the page: shown on hover, keyboard focus or tap of an element with data-tip, gone with Escape; what only who
// uses the keyboard needs to know is data-tip-keys.

import { h } from "./format.js";

const MARGIN = 8;

export function mount(tip) {
  let owner = null;
  let timer = 0;

  function show(element) {
    owner = element;
    tip.textContent = element.dataset.tip ?? element.dataset.tipKeys;
    tip.hidden = false;
    const at = element.getBoundingClientRect();
    const size = tip.getBoundingClientRect();
    // beside a control at the right of the page, so that nothing of it is covered; else below or above
    const aside = at.left - size.width - 3 * MARGIN;
    const beside = at.left > innerWidth / 2 && aside > MARGIN;
    const left = beside ? aside : Math.min(Math.max(MARGIN, at.left), innerWidth - size.width - MARGIN);
    const below = beside ? Math.min(at.top, innerHeight - size.height - MARGIN) : at.bottom + MARGIN;
    const top = below + size.height > innerHeight ? at.top - size.height - MARGIN : below;
    tip.style.left = `${left}px`;
    tip.style.top = `${Math.max(MARGIN, top)}px`;
  }

  function hide() {
    clearTimeout(timer);
    owner = null;
    tip.hidden = true;
  }

  const owning = (event) => event.target.closest?.("[data-tip]") ?? null;

  document.addEventListener("pointerover", (event) => {
    const element = owning(event);
    if (element === owner || event.pointerType === "touch") return;
    hide();
    if (element !== null) timer = setTimeout(() => show(element), 350);
  });
  document.addEventListener("focusin", (event) => {
    const element = event.target.closest?.("[data-tip], [data-tip-keys]") ?? null;
    if (element !== null && element.matches(":focus-visible")) show(element);
    else hide();
  });
  document.addEventListener("focusout", hide);
  document.addEventListener("click", (event) => {
    const element = owning(event);
    if (element === null || element.dataset.tipTap === undefined) hide();
    else show(element);
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") hide();
  });
  // the focus scrolls to what it comes to: its tip goes along
  const moved = () => (owner !== null && owner === document.activeElement ? show(owner) : hide());
  document.addEventListener("scroll", moved, { capture: true, passive: true });
}

/** The physics of a control for screen readers: an element to which aria-describedby points. */
export function hiddenTip(id, text) {
  return h("span", { id, class: "hidden-text" }, text);
}
