// Controls, analysis and set-up share the place below the picture; where there is room for the controls beside it, the others do.

const WIDE = matchMedia("(min-width: 1000px)");

export function mount(element, work) {
  const buttons = [...element.querySelectorAll("button")];
  const show = (section) => {
    work.dataset.section = section;
    const seen = section === "controls" && WIDE.matches ? "analysis" : section;
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.section === seen));
  };
  for (const button of buttons) button.addEventListener("click", () => show(button.dataset.section));
  WIDE.addEventListener("change", () => show(work.dataset.section));
  show("controls");
}
