// Where there is no room for both beside each other, controls and analysis share the place below the picture.

export function mount(element, work) {
  const buttons = [...element.querySelectorAll("button")];
  const show = (section) => {
    work.dataset.section = section;
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.section === section));
  };
  for (const button of buttons) button.addEventListener("click", () => show(button.dataset.section));
  show("controls");
}
