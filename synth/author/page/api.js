// The way to the server: JSON over HTTP, and one WebSocket for a document's news and sound.
//
//   const api = createApi();
//   await api.get("/api/session");                  // JSON; throws ApiError {status, message, errors, reason}
//   await api.post("/api/open", {preset: "tanpura"});
//   api.socket.connect(doc);                        // /ws/DOC, reconnects by itself until connect(null) or "gone"
//   api.socket.on("state", (message) => ...);       // JSON messages by their type; returns a function that ends it
//   api.socket.on("binary", (arrayBuffer) => ...);  // binary frames as they are
//   api.socket.on("open" | "closed", () => ...);    // the connection itself
//   api.socket.on("gone", () => ...);               // a server answers that does not know this page or its document
//   api.socket.send({type: "note_on", key: 48, velocity: 90});  // false where there is no connection

/** A request that the server refused, or that did not reach it (status 0). */
export class ApiError extends Error {
  constructor(status, message, body = {}) {
    super(message);
    this.name = "ApiError";
    this.status = status;
    this.errors = body.errors ?? [];
    this.reason = body.reason ?? null;
  }
}

// The server closes a connection with this where the document belongs to an earlier run (NO_DOCUMENT in app.py).
const NO_DOCUMENT = 4404;
const [FIRST_PAUSE_MS, LONGEST_PAUSE_MS] = [250, 30000];

export function createApi() {
  async function request(method, path, { body, signal } = {}) {
    const options = { method, signal, headers: {}, credentials: "same-origin" };
    if (body instanceof Blob || body instanceof ArrayBuffer) {
      options.body = body;
    } else if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    let response;
    try {
      response = await fetch(path, options);
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new ApiError(0, "The program does not answer. Your work is autosaved beside the file.");
    }
    if (!response.ok) {
      const text = await response.text();
      let said = {};
      try {
        said = JSON.parse(text);
      } catch {
        // a plain line, as the guard answers
      }
      throw new ApiError(response.status, said.error ?? (text.trim() || `The server answered ${response.status}.`), said);
    }
    return response.json();
  }

  return {
    get: (path, options) => request("GET", path, options),
    post: (path, body = {}, options) => request("POST", path, { ...options, body }),
    del: (path) => request("DELETE", path),
    socket: createSocket(),
  };
}

function createSocket() {
  const listeners = new Map();
  let doc = null;
  let socket = null;
  let timer = 0;
  let pause = FIRST_PAUSE_MS;

  function emit(type, message) {
    for (const listener of listeners.get(type) ?? []) listener(message);
  }

  function dial() {
    clearTimeout(timer);
    timer = 0;
    if (doc === null) return;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const mine = new WebSocket(`${scheme}://${location.host}/ws/${encodeURIComponent(doc)}`);
    mine.binaryType = "arraybuffer";
    socket = mine;
    mine.addEventListener("open", () => {
      if (mine !== socket) return;
      pause = FIRST_PAUSE_MS;
      emit("open");
    });
    mine.addEventListener("message", ({ data }) => {
      if (mine !== socket) return;
      if (typeof data === "string") {
        const message = JSON.parse(data);
        emit(message.type, message);
      } else {
        emit("binary", data);
      }
    });
    mine.addEventListener("close", ({ code }) => {
      if (mine !== socket) return;
      socket = null;
      emit("closed");
      if (code === NO_DOCUMENT) emit("gone");
      else wait();
    });
  }

  function wait() {
    clearTimeout(timer);
    timer = setTimeout(redial, pause);
    pause = Math.min(2 * pause, LONGEST_PAUSE_MS);
  }

  /** Connect again, if there is a server that still has the document: a WebSocket does not say why it is refused. */
  async function redial() {
    timer = 0;
    const wanted = doc;
    if (wanted === null || socket !== null) return;
    const answer = await fetch(`/api/docs/${encodeURIComponent(wanted)}`).catch(() => null);
    if (wanted !== doc || socket !== null || timer) return;
    if (answer?.ok) dial();
    else if (answer?.status === 403 || answer?.status === 404) emit("gone");
    else wait();
  }

  // whoever comes back to the tab does not wait
  window.addEventListener("focus", () => {
    if (!timer) return;
    clearTimeout(timer);
    redial();
  });

  return {
    connect(wanted) {
      if (wanted === doc && socket !== null) return;
      doc = wanted;
      const old = socket;
      socket = null;
      old?.close();
      pause = FIRST_PAUSE_MS;
      dial();
    },
    on(type, listener) {
      if (!listeners.has(type)) listeners.set(type, new Set());
      listeners.get(type).add(listener);
      return () => listeners.get(type).delete(listener);
    },
    send(message) {
      if (socket === null || socket.readyState !== WebSocket.OPEN) return false;
      socket.send(message instanceof ArrayBuffer ? message : JSON.stringify(message));
      return true;
    },
  };
}
