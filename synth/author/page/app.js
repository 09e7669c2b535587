// The page: puts the modules into their places, shows what concerns the whole, and opens the first document.

import { mount as mountAnalysis } from "./analysis.js";
import { createApi } from "./api.js";
import { mount as mountControls } from "./controls.js";
import { mount as mountFiles } from "./files.js";
import { mount as mountFit } from "./fit.js";
import { mount as mountHeader } from "./header.js";
import { mount as mountInstrument } from "./instrument.js";
import { mount as mountKeyboard } from "./keyboard.js";
import { mount as mountNotices } from "./notices.js";
import { mount as mountPlayer } from "./player.js";
import { mount as mountSections } from "./sections.js";
import { mount as mountSetup } from "./setup.js";
import { mount as mountStart } from "./start.js";
import { createStore } from "./store.js";
import { mount as mountTip } from "./tip.js";

const api = createApi();
const store = createStore(api);
const at = (id) => document.getElementById(id);
const parts = { store, api };

mountTip(at("tip"));
mountNotices(at("notices"), parts);
mountHeader(document, parts);
mountStart(at("start"), parts);
mountFiles(at("files"), parts);
mountInstrument(at("instrument"), parts);
mountControls(at("controls"), parts);
mountAnalysis(at("analysis"), parts);
mountSetup(at("setup"), parts);
mountSections(at("sections"), at("work"));
mountPlayer(at("player"), parts);
mountKeyboard(at("keyboard"), parts);
mountFit(at("fit"), parts);

// notices stand above the dock, whatever it shows
new ResizeObserver(() => {
  document.documentElement.style.setProperty("--dock", `${at("dock").offsetHeight}px`);
}).observe(at("dock"));

store.on(["doc", "session"], ({ doc, session }) => {
  at("start").hidden = doc !== null || session === null;
  at("work").hidden = doc === null;
  at("dock").hidden = doc === null;
});

/** The document of an address; none where it is no name. */
function named(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return "";
  }
}

// the secret that the address may carry stays out of the tab, its bookmarks and the browser's history
history.replaceState(null, "", location.pathname + location.hash);

// A reload of the tab goes on with its document; else what the command line named; else the page asks.
const session = await store.refreshSession();
const before = named(location.hash.slice(1));
const known = before !== "" && (await api.get(`/api/docs/${encodeURIComponent(before)}`).catch(() => null)) !== null;
if (known) await store.resume(before);
else if (session?.opened) await store.resume(session.opened);

document.documentElement.dataset.ready = "yes";
