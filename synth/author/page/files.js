// Open, save, save as, duplicate, import, export; recovery and changes on disk.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

import { makeBrowser } from "./browse.js";
import { h } from "./format.js";
import { moment, where } from "./presets.js";
import { dropTarget, menu, sheet } from "./sheets.js";

const LONGEST_PRESET = 1e6;
/** Most comparisons of lines that are made to show what changed. */
const MOST_COMPARED = 4e6;

/** What the fields of a name take: the file's name without its ending. */
export const stem = (file) => file.replace(/\.toml$/i, "");

export function mount(element, { store, api }) {
  const doc = () => store.state.doc;
  const ownFile = () => doc()?.file && !doc().embedded;

  // ---- open
  async function open() {
    const [session, browser] = await Promise.all([store.refreshSession(), makeBrowser({ store, api, open: (preset) => choose(preset) })]);
    const presets = session?.presets ?? [];
    const choose = async (preset) => {
      dialog.close();
      await store.open(preset);
    };
    const unsaved = presets.filter((preset) => preset.unsaved);
    const own = presets.filter((preset) => !preset.embedded && !preset.unsaved);
    const list = (title, some) =>
      some.length === 0
        ? []
        : [
            h("h3", {}, title),
            h(
              "ul",
              { class: "file-list" },
              ...some.map((preset) =>
                h(
                  "li",
                  {},
                  h(
                    "button",
                    {
                      type: "button",
                      class: "quiet",
                      "data-preset": preset.file ?? preset.name,
                      disabled: preset.reason !== null,
                      onclick: () => choose(preset),
                    },
                    h("span", {}, preset.title || preset.name),
                    h("span", { class: "unit" }, where(preset)),
                  ),
                ),
              ),
            ),
          ];
    const dirty = doc()?.dirty
      ? [
          h(
            "p",
            { class: "muted" },
            `${doc().name} has unsaved changes. They are kept, and offered when you open it again.`,
          ),
        ]
      : [];
    const dialog = sheet(
      "Open",
      [
        ...dirty,
        ...list("Not saved", unsaved),
        ...list(session ? session.folder : "", own),
        h("h3", {}, "Built in"),
        browser.element,
      ],
      [h("button", { type: "button", onclick: () => (dialog.close(), picker.click()) }, "Import a file…")],
      { small: false, onclose: browser.silence },
    );
    browser.search.focus();
  }

  // ---- save
  async function save() {
    if (!doc()) return null;
    if (!ownFile()) return saveAs();
    return settle(await store.save());
  }

  function settle(result) {
    if (result?.refused?.reason === "changed-on-disk") return askOverwrite(result.refused.message);
    if (result?.refused) return store.notify(result.refused.message, "error");
    if (result) store.notify(`Saved as ${result.file}`);
    return result;
  }

  function askOverwrite(message) {
    const act = async (action, words) => {
      dialog.close();
      const result = await action();
      if (result?.refused) store.notify(result.refused.message, "error");
      else if (result) store.notify(words);
    };
    const dialog = sheet(
      "The file has changed",
      [h("p", {}, message), h("p", { class: "muted" }, "Another program has written to it since you opened it here.")],
      [
        h(
          "button",
          { type: "button", onclick: () => act(() => store.reload(), "Loaded the file's version; undo brings yours back") },
          "Load the file",
        ),
        h(
          "button",
          { type: "button", class: "primary", onclick: () => act(() => store.save(true), "Overwritten") },
          "Overwrite the file",
        ),
      ],
    );
  }

  const saveAs = () => askName("Save as", "Save", (name, overwrite) => store.saveAs(name, overwrite), "Saved as");
  const duplicate = () => askName("Duplicate", "Duplicate", (name) => store.duplicate(name), "Now working on", "-copy");

  /** Ask for a name in the folder; one that is taken is written over only when the button says so. */
  function askName(title, verb, action, done, ending = "") {
    if (!doc()) return;
    let over = null;
    const begin = doc().file ? stem(doc().file) : doc().name;
    const field = h("input", {
      type: "text",
      id: "file-name",
      value: begin + ending,
      spellcheck: "false",
      autocomplete: "off",
    });
    const error = h("p", { class: "field-error", role: "alert" });
    const button = h("button", { type: "submit", class: "primary" }, verb);
    const form = h(
      "form",
      { class: "name-form" },
      h("label", { for: "file-name" }, "Name"),
      h("span", { class: "name-field" }, field, h("span", { class: "unit" }, ".toml")),
      h("p", { class: "unit" }, `in ${store.state.session?.folder ?? "the folder"}`),
      error,
      h("div", { class: "sheet-actions" }, button),
    );
    field.addEventListener("input", () => {
      over = null;
      error.textContent = "";
      field.removeAttribute("aria-invalid");
      button.textContent = verb;
    });
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      const name = stem(field.value.trim());
      const { title: before } = doc();
      const result = await action(name, over === name);
      if (result?.refused) {
        error.textContent = result.refused.message;
        field.setAttribute("aria-invalid", "true");
        if (action.length > 1 && result.refused.reason === "exists") {
          over = name;
          button.textContent = "Overwrite it";
        }
      } else if (result) {
        dialog.close();
        const titled = result.title === before ? "" : `, with the title “${result.title}”`;
        store.notify(`${done} ${result.file ?? result.name}${titled}`);
        store.refreshSession();
      }
    });
    const dialog = sheet(title, [form]);
    field.select();
  }

  // ---- import, export
  const picker = h("input", {
    type: "file",
    accept: ".toml,application/toml",
    class: "hidden-text",
    tabindex: -1,
    "aria-label": "Import a preset",
    onchange: () => {
      if (picker.files[0]) take(picker.files[0]);
      picker.value = "";
    },
  });

  async function take(file) {
    if (file.size > LONGEST_PRESET) {
      store.notify(
        `${file.name}: ${Math.round(file.size / 1000)} kB; a preset has at most ${LONGEST_PRESET / 1000} kB`,
        "error",
      );
      return;
    }
    let text;
    try {
      text = new TextDecoder("utf-8", { fatal: true }).decode(await file.arrayBuffer());
    } catch {
      store.notify(`${file.name}: not a text file in UTF-8; save it as one in the program that wrote it`, "error");
      return;
    }
    const result = await store.importText(file.name, text);
    if (result && !result.refused) store.notify(`${file.name} is imported; save it to keep it in the folder`);
  }
  dropTarget((file) => /\.toml$/i.test(file.name), take);

  function exportFile() {
    const link = h("a", { href: `/api/docs/${encodeURIComponent(doc().doc)}/export`, download: `${doc().name}.toml` });
    document.body.append(link);
    link.click();
    link.remove();
  }

  // ---- throw away what was never saved
  let leaving = false;

  /** Nothing is open any more: the page begins anew. */
  function leave() {
    leaving = true;
    history.replaceState(null, "", location.pathname);
    location.reload();
  }

  function askDiscard() {
    const { doc: id, name } = doc();
    const dialog = sheet(
      "Discard?",
      [h("p", {}, `${name} was never saved. Nothing of it will be kept.`)],
      [
        h(
          "button",
          {
            type: "button",
            class: "primary",
            onclick: async () => {
              dialog.close();
              try {
                await api.post(`/api/docs/${encodeURIComponent(id)}/discard`);
                leave();
              } catch (error) {
                store.notify(error.message, "error");
              }
            },
          },
          "Discard it",
        ),
      ],
    );
  }
  api.socket.on("moved", (message) => message.doc === null && leave());

  // ---- buttons
  const none = { disabled: () => doc() === null };
  const saveButton = h(
    "button",
    { type: "button", id: "save", disabled: true, "aria-keyshortcuts": "Control+S", onclick: save },
    "Save",
  );
  element.append(
    h("button", { type: "button", id: "open", "aria-keyshortcuts": "Control+O", onclick: open }, "Open…"),
    saveButton,
    menu(
      "More",
      [
        ["Save as…", saveAs, { ...none, key: "Ctrl Shift S" }],
        ["Duplicate…", duplicate, none],
        ["Import…", () => picker.click()],
        ["Export", exportFile, none],
        ["Back to saved", () => store.revert(), { disabled: () => !doc()?.dirty }],
        ["Discard…", askDiscard, { disabled: () => !doc() || ownFile() || doc().embedded }],
      ],
      { id: "more" },
    ),
    picker,
  );
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const key = event.key.toLowerCase();
    if (key !== "s" && key !== "o") return;
    event.preventDefault();
    if (document.querySelector("dialog[open]")) return;
    // what is typed in a field and not yet entered is meant too
    if (event.target.dataset?.typing === "yes") event.target.dispatchEvent(new Event("change", { bubbles: true }));
    if (key === "o") open();
    else if (event.shiftKey) saveAs();
    else save();
  });

  // ---- what happened to the file
  const banners = h("div", { id: "file-banners" });
  document.getElementById("banner").after(banners);

  function banner(kind, words, actions) {
    return h(
      "div",
      { class: `banner ${kind}`, role: "alert" },
      h("span", {}, words),
      h("span", { class: "banner-actions" }, ...actions),
    );
  }
  const act = (label, action, primary = false) =>
    h("button", { type: "button", class: primary ? "primary" : null, onclick: action }, label);

  store.on(["doc"], ({ doc: state }) => {
    saveButton.disabled = !state || (!state.dirty && Boolean(ownFile()) && state.disk !== "gone");
    saveButton.textContent = state && !ownFile() ? "Save…" : "Save";
    const shown = [];
    if (state?.recovered) {
      shown.push(
        banner("offer", `Unsaved changes to ${state.name} were found, from ${moment(state.recovered.when)}.`, [
          act("Restore them", () => store.recover(true), true),
          act("Compare them", () => compareTexts(state)),
          act("Discard them", () => store.recover(false)),
        ]),
      );
    }
    if (state?.autosave_problem) {
      shown.push(
        banner("warn", `Your changes cannot be autosaved: ${state.autosave_problem}. Save or export them.`, [
          act("Save as…", saveAs),
        ]),
      );
    }
    if (state?.disk === "changed") {
      shown.push(
        banner("warn", `${state.file} was changed by another program.`, [
          act(state.dirty ? "Load it, dropping my changes" : "Load it", () => store.reload(), true),
          act("Overwrite it", async () => settle(await store.save(true))),
        ]),
      );
    }
    if (state?.disk === "gone") {
      shown.push(
        banner("warn", `${state.file} no longer exists. The version shown here is still intact.`, [
          act("Save it again", async () => settle(await store.save(true)), true),
          act("Save as…", saveAs),
        ]),
      );
    }
    banners.replaceChildren(...shown);
  });

  function compareTexts(state) {
    const rows = difference(state.text.split("\n"), state.recovered.text.split("\n"));
    sheet(
      "Unsaved changes",
      [
        h(
          "pre",
          { class: "text-difference", tabindex: 0 },
          ...rows.map(([sign, line]) =>
            h("span", { class: sign === "+" ? "added" : sign === "-" ? "removed" : null }, `${sign} ${line}\n`),
          ),
        ),
      ],
      [],
      { small: false },
    );
  }

  window.addEventListener("beforeunload", (event) => {
    if (doc()?.dirty && !leaving) event.preventDefault();
  });
}

/** What changed between two lists of lines: [[" " | "-" | "+", line]], changed ones with two lines round them. */
export function difference(before, after) {
  let same = 0; // at the end
  const shorter = Math.min(before.length, after.length);
  while (same < shorter && before.at(-1 - same) === after.at(-1 - same)) same++;
  let first = 0; // at the beginning
  while (first < shorter - same && before[first] === after[first]) first++;
  const equal = (line) => [" ", line];
  const end = before.slice(before.length - same).map(equal);
  const rows = before.slice(0, first).map(equal);
  rows.push(...compared(before.slice(first, before.length - same), after.slice(first, after.length - same)), ...end);
  const near = (k) => rows.slice(Math.max(0, k - 2), k + 3).some(([sign]) => sign !== " ");
  return rows.filter((_, k) => near(k));
}

/** All lines of both, with the longest common part; of very long ones all that is gone, then all that has come. */
function compared(before, after) {
  if (before.length * after.length > MOST_COMPARED)
    return [...before.map((line) => ["-", line]), ...after.map((line) => ["+", line])];
  const table = Array.from({ length: before.length + 1 }, () => new Uint16Array(after.length + 1));
  for (let i = before.length - 1; i >= 0; i--)
    for (let j = after.length - 1; j >= 0; j--)
      table[i][j] = before[i] === after[j] ? table[i + 1][j + 1] + 1 : Math.max(table[i + 1][j], table[i][j + 1]);
  const rows = [];
  let [i, j] = [0, 0];
  while (i < before.length || j < after.length) {
    if (i < before.length && j < after.length && before[i] === after[j]) {
      rows.push([" ", before[i++]]);
      j++;
    } else if (j >= after.length || (i < before.length && table[i + 1][j] >= table[i][j + 1])) rows.push(["-", before[i++]]);
    else rows.push(["+", after[j++]]);
  }
  return rows;
}
