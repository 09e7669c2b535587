// The header: name and state of the document, undo and redo, edited or saved version, theme, the fit sheet.

import { toolbar } from "./roving.js";
import { stepName } from "./wording.js";

/** Loading kernels that are compiled already takes no longer than this. */
const LOADING_MS = 5000;
const THEMES = { auto: "as the system", light: "light", dark: "dark" };

export function mount(page, { store, api }) {
  const at = (id) => page.getElementById(id);
  const undo = at("undo");
  const redo = at("redo");

  // the address names the document: what it skips to is no part of it
  page.querySelector(".skip").addEventListener("click", (event) => {
    event.preventDefault();
    at("controls").focus();
  });
  undo.addEventListener("click", () => store.undo());
  redo.addEventListener("click", () => store.redo());
  page.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    // in a field that is being written, the browser's own undo of typing
    const field = event.target.closest?.("textarea, input[type=text], input[type=search]");
    if (field && (field.dataset.typing === "yes" || !field.closest("[data-path]"))) return;
    const key = event.key.toLowerCase();
    const back = key === "z" && !event.shiftKey;
    const forth = (key === "z" && event.shiftKey) || key === "y";
    if (!back && !forth) return;
    event.preventDefault();
    if (back) store.undo();
    else store.redo();
  });

  for (const part of page.querySelectorAll(".bar [role=toolbar]")) toolbar(part);

  const versions = [...at("ab").querySelectorAll("[role=radio]")];
  for (const button of versions) {
    button.addEventListener("click", () => store.setWhich(button.dataset.which));
    button.addEventListener("keydown", (event) => {
      if (!["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].includes(event.key)) return;
      event.preventDefault();
      const other = versions.find((one) => one !== button);
      store.setWhich(other.dataset.which);
      other.focus();
    });
  }

  at("theme").addEventListener("click", () => {
    const names = Object.keys(THEMES);
    store.setTheme(names[(names.indexOf(store.state.theme) + 1) % names.length]);
  });

  const sheet = at("fit-dialog");
  at("open-fit").addEventListener("click", () => sheet.showModal());
  // a click beside the sheet closes it
  sheet.addEventListener("click", (event) => {
    if (event.target === sheet) sheet.close();
  });

  store.on(["doc"], ({ doc }) => {
    at("title").textContent = doc?.title || doc?.name || "jawari";
    page.title = doc ? `${doc.dirty ? "• " : ""}${doc.name} – jawari` : "jawari";
    const status = at("doc-status");
    status.textContent = doc === null ? "" : doc.dirty ? "edited" : (doc.file ?? (doc.embedded ? "built in" : "not saved"));
    status.classList.toggle("edited", doc?.dirty ?? false);
    undo.disabled = !doc?.can_undo;
    redo.disabled = !doc?.can_redo;
    for (const part of page.querySelectorAll(".bar-tools")) part.hidden = doc === null;
  });
  store.on(["doc", "parameters"], ({ doc, parameters }) => {
    const step = (label) => (label ? `: ${stepName(label, parameters, doc.data)}` : "");
    undo.title = `Undo${step(doc?.undo_label)}`;
    redo.title = `Redo${step(doc?.redo_label)}`;
  });
  store.on(["which"], ({ which }) => {
    page.documentElement.dataset.which = which;
    for (const button of versions) {
      const chosen = button.dataset.which === which;
      button.setAttribute("aria-checked", chosen);
      button.tabIndex = chosen ? 0 : -1;
    }
  });
  store.on(["theme"], ({ theme }) => {
    if (theme === "auto") delete page.documentElement.dataset.theme;
    else page.documentElement.dataset.theme = theme;
    at("theme-label").textContent = `Colours: ${THEMES[theme]}`;
    at("theme").title = `Colours: ${THEMES[theme]}`;
  });
  const banner = at("banner");
  let patience = 0;
  let long = false;
  let gone = false;
  const words = page.createElement("span");
  const bar = page.createElement("progress");
  bar.setAttribute("aria-label", "Preparing the string engine");
  // the figures change twice a second: for eyes only, a screen reader asks the bar
  const figures = page.createElement("span");
  figures.className = "figures";
  figures.setAttribute("aria-hidden", "true");
  const tell = ({ connected, kernels, compiling }) => {
    const preparing = connected && kernels === "loading" && (long || compiling !== null);
    banner.hidden = connected && !preparing;
    banner.classList.toggle("calm", preparing);
    const said = banner.hidden
      ? ""
      : preparing
        ? compiling === null
          ? "Loading the string engine. You can already edit; sound and analysis follow."
          : "Preparing the string engine, once on this machine: half a minute to two minutes, longer while it is busy. You can already edit; sound and analysis follow."
        : gone
          ? "The program was restarted, or this preset was closed in another tab. Continue in the newest tab and close this one."
          : "No connection to the program; your work so far is autosaved. If the program has ended, start it again: it opens in a new tab, and you can close this one.";
    if (words.textContent !== said) words.textContent = said;
    const shown = preparing && compiling !== null ? [words, bar, figures] : [words];
    if (banner.childElementCount !== shown.length) banner.replaceChildren(...shown);
    if (compiling === null) return;
    bar.value = compiling.share;
    figures.textContent = `${compiling.done} of ${compiling.total} kernels, ${Math.round(compiling.seconds)} s`;
  };
  store.on(["connected", "kernels", "compiling"], tell);
  for (const [type, value] of Object.entries({ gone: true, open: false })) {
    api.socket.on(type, () => {
      gone = value;
      tell(store.state);
    });
  }
  store.on(["kernels"], ({ kernels }) => {
    page.documentElement.dataset.kernels = kernels;
    clearTimeout(patience);
    long = false;
    if (kernels !== "loading") return;
    patience = setTimeout(() => {
      long = true;
      tell(store.state);
    }, LOADING_MS);
  });
}
