// What handles of a drawing do to the preset: edits that say where they are refused, and the way back.
//
//   makeHandles(panel, makeMoving(store, {held(bool), redraw()}))

import { wayBack } from "./edits.js";
import { same, valueAt } from "./format.js";

/** held: told when a hand takes something and lets go; redraw: called where what was moved has its old value still. */
export function makeMoving(store, { held, redraw }) {
  let hand = false;
  return {
    async edit(changes, key) {
      if ((await store.editMany(changes, key)) !== null) return;
      const { path } = changes.at(-1);
      const reason = store.state.errors[path];
      // the field may be out of sight, and it has its value still
      if (reason) store.notify(`Not moved. ${store.labelOf(path)}: ${reason}`, "error");
      store.clearError(path);
      if (!hand) redraw();
    },
    valueOf: (path) => store.value(path),
    /** What a double click brings back: the saved value of what has been changed, else the default of what has one. */
    backOf(path) {
      const parameter = store.state.parameters.find((one) => one.path === path);
      const value = store.value(path) ?? null;
      const saved = valueAt(store.state.doc.saved, path) ?? null;
      if (parameter === undefined) return saved === null || same(value, saved) ? null : { value: saved }; // one of a list
      return wayBack(parameter, value, saved);
    },
    busy(now) {
      hand = now;
      held(now);
      if (!now) redraw();
    },
  };
}
