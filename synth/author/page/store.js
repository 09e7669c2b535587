// What the page knows, and everything that can be done to it. Modules read `store.state`, subscribe to the parts that
// they show and call actions; no module speaks to another.
//
//   store.on(["doc", "note"], (state) => draw(state));   // once now, then after every change of one of these parts
//   store.subscribe((state, changed) => ...);            // after every change; `changed` is a Set of the names
//
// state.session   what GET /api/session said              state.doc       the server's state of the document, or null
// state.note      MIDI note looked at and played           state.velocity  1..127
// state.which     "current" | "saved" (A/B)                state.errors    {path: why the last edit was refused}
// state.connected the WebSocket is up                      state.theme     "auto" | "light" | "dark"
// state.table     number of the string that plays the note
// state.kernels   "loading" (nothing can be computed yet) | "ready"
// state.compiling  {done, total, share, seconds} of the kernels while they are compiled, else null
// state.parameters  what GET …/parameters lists, [] before it came
//
// store.data() is the preset of the version that is shown (state.which); store.value(path) one value of it.
// store.hear({note, velocity, string, opened}) plays a note of the edited version on one of its strings, by the table's number
// and the open note; who makes the sound has given store.onHear(listener).
// Actions return promises. They never throw: what the server refuses is shown as a notice, a refused edit (422) at its field
// by state.errors, and the promise gives null. Who asks for a name, to save or for a fit is given what is refused, as
// {refused: {message, reason}}, to say it where it was asked for.
// Refusals at fields go with their cause: when the value is changed, by whomever, or the text as a whole; not by the answer to
// an edit that was sent before what is refused was typed.

import { ApiError } from "./api.js";
import { noteName, same as equal, valueAt } from "./format.js";
import { inWords, labelOf } from "./wording.js";

const THEME = "jawari-theme";
/** The note of a document, kept over reloads of the tab. */
const NOTE = "jawari-note-";
const KERNELS_MS = 1000;

export function createStore(api) {
  const listeners = new Set();
  const notices = new Set();
  const hearers = new Set();
  let state = {
    session: null,
    doc: null,
    note: 60,
    velocity: 90,
    table: 0,
    kernels: "ready",
    compiling: null,
    parameters: [],
    which: "current",
    errors: {},
    connected: true,
    theme: localStorage.getItem(THEME) ?? "auto",
  };
  let changed = new Set();

  function set(patch) {
    let any = false;
    for (const [name, value] of Object.entries(patch)) {
      if (state[name] === value) continue;
      if (changed.size === 0 && !any) queueMicrotask(tell);
      any = true;
      changed.add(name);
    }
    if (any) state = { ...state, ...patch };
  }

  function tell() {
    const now = changed;
    changed = new Set();
    for (const listener of [...listeners]) listener(state, now);
  }

  function subscribe(listener) {
    listeners.add(listener);
    return () => listeners.delete(listener);
  }

  function on(names, listener) {
    listener(state);
    return subscribe((next, now) => {
      if (names.some((name) => now.has(name))) listener(next);
    });
  }

  // ---- notices: short lines, also read aloud by screen readers
  function notify(text, kind = "info") {
    for (const listener of notices) listener({ text, kind });
  }

  function failed(error) {
    if (error.name === "AbortError") return null;
    if (!(error instanceof ApiError)) throw error;
    notify(inSum(error), "error");
    return null;
  }

  const inSum = (error) => (error.errors.length > 0 ? error.errors.map(said).join("; ") : error.message);

  const label = (path) => labelOf(path, state.parameters, state.doc?.data);

  /** A reason of the server in the words of the controls. */
  function said({ path, message }) {
    const words = inWords(message, state.parameters);
    return path === "file" ? words : `${label(path)}: ${words}`;
  }

  // ---- the document
  /** Take a state of the server; older ones than the present are left aside. */
  function take(doc) {
    if (!doc) return doc;
    const same = state.doc?.doc === doc.doc;
    if (same && doc.revision < state.doc.revision) return state.doc;
    const patch = { doc };
    if (!same) {
      patch.errors = {};
      patch.which = "current";
      api.socket.connect(doc.doc);
      history.replaceState(null, "", `${location.pathname}#${encodeURIComponent(doc.doc)}`);
      for (const text of doc.notices ?? []) notify(text);
    }
    if (!same) patch.note = Number(sessionStorage.getItem(NOTE + doc.doc) ?? doc.first_note);
    if (same) patch.errors = stillWrong(state.doc.data, doc.data);
    const note = patch.note ?? state.note;
    if (doc.notes.length > 0 && !doc.notes.includes(note)) {
      patch.note = doc.notes.reduce((best, one) => (Math.abs(one - note) < Math.abs(best - note) ? one : best));
      if (same) notify(`${noteName(note)} is no longer playable; now at ${noteName(patch.note)}`);
    }
    set(patch);
    return doc;
  }

  /** Reasons whose field is still there, with the value that it had. */
  function stillWrong(before, after) {
    const kept = Object.entries(state.errors).filter(([path]) => {
      const parent = path.split(".").slice(0, -1).join(".");
      const there = parent === "" || (valueAt(after, parent) ?? null) !== null;
      return there && (newer(path, answered) || equal(valueAt(before, path), valueAt(after, path)));
    });
    return kept.length === Object.keys(state.errors).length ? state.errors : Object.fromEntries(kept);
  }

  /** `asks`: the caller says what is refused. */
  async function act(request, { asks = false } = {}) {
    try {
      return take(await request);
    } catch (error) {
      if (asks && error instanceof ApiError) return { refused: { message: inSum(error), reason: error.reason } };
      return failed(error);
    }
  }

  /** What changes the whole text: it is the edited version that is seen then, and no refusal stands any more. */
  async function changeAll(action, body, options = {}) {
    if (state.which === "saved") set({ which: "current" });
    const result = await act(after(action, body), options);
    if (result !== null && !result.refused && Object.keys(state.errors).length > 0) set({ errors: {} });
    return result;
  }

  const here = (action) => `/api/docs/${encodeURIComponent(state.doc.doc)}/${action}`;

  /** POST what concerns the whole document when the edits before it have come. */
  async function after(action, body) {
    const url = here(action);
    await sent;
    return api.post(url, body);
  }

  /** Undo or redo, where there is something after the edits that are on their way. */
  async function stepThere(action, possible) {
    if (state.doc !== null) await sent;
    return state.doc?.[possible] ? changeAll(action) : null;
  }

  // Edits leave one after the other; while one is under way, later ones of the same drag replace each other.
  const queue = [];
  // numbers of the last edit that was given, and of the last that was answered
  let given = 0;
  let answered = 0;
  // path of a refused value → number of the last edit that was given before it was typed
  const refusedAfter = new Map();

  /** Whether what was typed there and refused was typed after edit `number`, the next of which is not answered yet. */
  const newer = (path, number) => (refusedAfter.get(path) ?? 0) > number;
  let looking = 0;
  let sending = false;
  let sent = Promise.resolve();

  function send() {
    if (!sending) sent = sendAll();
  }

  async function sendAll() {
    sending = true;
    while (queue.length > 0) {
      const job = queue.shift();
      let result = null;
      try {
        result = take(await api.post(job.url, { changes: job.changes, merge: job.merge }));
        const errors = { ...state.errors };
        for (const { path } of job.changes) if (!newer(path, job.number - 1)) delete errors[path];
        set({ errors });
      } catch (error) {
        if (error instanceof ApiError && error.status === 422) refuse(job.changes, error);
        else failed(error);
      }
      answered = job.number;
      for (const done of job.waiting) done(result);
    }
    sending = false;
  }

  function refuse(changes, error) {
    const errors = { ...state.errors };
    const reasons = error.errors.length > 0 ? error.errors : [{ path: changes[0].path, message: error.message }];
    for (const { path, message } of reasons) {
      // a reason that names a table, or a value inside one, belongs to the field that was just edited
      const field = changes.find((c) => c.path === path || path.startsWith(`${c.path}.`)) ?? changes[0];
      errors[field.path] = path === field.path ? inWords(message, state.parameters) : said({ path, message });
    }
    set({ errors });
  }

  function editMany(changes, merge = null) {
    if (state.doc === null) return Promise.resolve(null);
    if (state.which === "saved") set({ which: "current" });
    const url = here("edit");
    return new Promise((done) => {
      const last = queue.at(-1);
      const same =
        last && merge !== null && last.merge === merge && last.url === url && last.changes.length === changes.length &&
        last.changes.every((c, i) => c.path === changes[i].path);
      if (same) {
        last.changes = changes;
        last.waiting.push(done);
        last.number = given += 1;
      } else {
        queue.push({ url, changes, merge, waiting: [done], number: (given += 1) });
      }
      send();
    });
  }

  /**
   * Kernels that were loading may be there: a socket, which would say so, is there for documents only. Without a
   * connection nothing is asked: that is taken up again with the connection.
   */
  async function lookAgain() {
    clearTimeout(looking);
    if (state.kernels !== "loading" || !state.connected) return;
    const now = await api.get("/api/kernels").catch(() => null);
    if (now !== null) set({ kernels: now.kernels, compiling: now.compiling });
    lookLater();
  }

  function lookLater() {
    clearTimeout(looking);
    if (state.kernels === "loading") looking = setTimeout(lookAgain, KERNELS_MS);
  }

  const actions = {
    /** A row of the session's presets. */
    open: ({ file, name, unsaved }) => act(api.post("/api/open", unsaved ? { unsaved: name } : { preset: file ?? name })),
    importText: (filename, text) => act(api.post("/api/import", { filename, text })),
    /** The document of this id, as after a reload of the tab. */
    resume: (doc) => act(api.get(`/api/docs/${encodeURIComponent(doc)}`)),
    /** One value; null puts it back to its default. Edits with the same `mergeKey` are one step of undo. */
    edit: (path, value, mergeKey = null) => editMany([{ path, value }], mergeKey),
    /** Several values at once, [{path, value}]: all or none. */
    editMany,
    undo: () => stepThere("undo", "can_undo"),
    redo: () => stepThere("redo", "can_redo"),
    revert: () => changeAll("revert"),
    randomise: (groups = null, seed = null) => changeAll("randomise", { seed, groups }),
    save: (force = false) => act(after("save", { force }), { asks: true }),
    saveAs: (name, overwrite = false) => act(after("save-as", { name, overwrite }), { asks: true }),
    duplicate: (name) => act(after("duplicate", { name }), { asks: true }),
    recover: (takeIt) => changeAll("recover", { take: takeIt }),
    reload: () => changeAll("reload"),
    applyFit: (job) => changeAll("apply-fit", { job }, { asks: true }),
    setParameters: (parameters) => set({ parameters }),
    /** The words for a value's path: "Pa string, Length". */
    labelOf: label,
    /** A GET of the document, /api/docs/DOC/WHAT?…, for what is shown of it; throws ApiError. */
    view: (what, query = {}, options = {}) => api.get(`${here(what)}?${new URLSearchParams(query)}`, options),
    refreshSession: async () => {
      try {
        const session = await api.get("/api/session");
        set({ session, kernels: session.kernels, compiling: session.compiling });
        lookLater();
      } catch (error) {
        failed(error);
      }
      return state.session;
    },
    setNote: (note) => {
      if (state.doc !== null && !state.doc.notes.includes(note)) return;
      set({ note });
      if (state.doc !== null) sessionStorage.setItem(NOTE + state.doc.doc, note);
    },
    setTable: (table) => set({ table }),
    setVelocity: (velocity) => set({ velocity: Math.max(1, Math.min(127, Math.round(velocity))) }),
    setWhich: (which) => set({ which }),
    setTheme: (theme) => {
      localStorage.setItem(THEME, theme);
      set({ theme });
    },
    /** A reason at a field that the server was not asked about. */
    refuse: (path, reason) => {
      refusedAfter.set(path, given);
      set({ errors: { ...state.errors, [path]: reason } });
    },
    clearError: (path) => {
      if (!(path in state.errors)) return;
      const errors = { ...state.errors };
      delete errors[path];
      set({ errors });
    },
  };

  api.socket.on("state", (message) => {
    if (message.state.doc === state.doc?.doc) take(message.state);
  });
  api.socket.on("disk", (message) => {
    if (state.doc) set({ doc: { ...state.doc, disk: message.disk } });
  });
  // saved over by another document, which goes on in its place
  api.socket.on("moved", ({ doc }) => doc !== null && actions.resume(doc));
  api.socket.on("kernels", ({ kernels, compiling }) => set({ kernels, compiling }));
  api.socket.on("error", (message) => notify(message.message, "error"));
  api.socket.on("open", () => {
    // what happened while the connection was down
    if (!state.connected && state.doc) actions.resume(state.doc.doc);
    set({ connected: true });
    lookLater();
  });
  api.socket.on("closed", () => set({ connected: false }));

  return {
    get state() {
      return state;
    },
    subscribe,
    on,
    notify,
    onNotice: (listener) => {
      notices.add(listener);
      return () => notices.delete(listener);
    },
    hear: (wanted) => {
      for (const hearer of hearers) hearer(wanted);
    },
    onHear: (hearer) => {
      hearers.add(hearer);
      return () => hearers.delete(hearer);
    },
    data: () => (state.doc === null ? null : state.which === "saved" ? state.doc.saved : state.doc.data),
    value: (path) => valueAt(state.which === "saved" ? state.doc?.saved : state.doc?.data, path),
    ...actions,
  };
}
