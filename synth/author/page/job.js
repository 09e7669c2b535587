// Work in the background of the server: its progress, its result, an end before it is done.

const EVERY_MS = 250;

/** Follow a job, given by its id or the promise of one: {result: promise, cancel()}. The promise rejects with the server's
 * reason, or when it is cancelled, which may be before the server has said the id. */
export function follow(api, asked, onProgress) {
  const path = Promise.resolve(asked).then((id) => `/api/jobs/${encodeURIComponent(id)}`);
  const result = (async () => {
    for (;;) {
      const job = await api.get(await path);
      if (job.state === "done") return job.result;
      if (job.state === "cancelled") throw new Error("Cancelled");
      if (job.state === "failed") throw new Error(job.error);
      onProgress(job.progress);
      await new Promise((done) => setTimeout(done, EVERY_MS));
    }
  })();
  return { result, cancel: async () => api.del(await path) };
}
