// Rows of the session's presets in words.

/** Where a preset comes from: its file, the program, or an earlier session; or why it cannot be opened. */
export function where({ name, file, unsaved, when, reason }) {
  if (reason !== null) return reason;
  if (unsaved) return `${name}: not saved, recovered from ${moment(when)}`;
  return file ?? "built in";
}

/** A time of the server (ISO 8601) for people. */
export function moment(when) {
  const date = new Date(when);
  const today = date.toDateString() === new Date().toDateString();
  return today
    ? date.toLocaleTimeString([], { timeStyle: "short" })
    : date.toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
}
