// For views that follow quick changes: one request at a time, and after it only the newest that is wanted by then.

/** The wrapped work; `work()` is run again at the end where it was called meanwhile. */
export function latest(work) {
  let running = false;
  let again = false;
  return async function run() {
    again = true;
    if (running) return;
    running = true;
    try {
      while (again) {
        again = false;
        await work();
      }
    } finally {
      running = false;
    }
  };
}
