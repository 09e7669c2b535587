// Work in the background of the server: its progress, its result, an end before it is done.

const EVERY_MS = 250;

/** Follow a job: {result: promise, cancel()}. The promise rejects with the server's reason, or when it is cancelled. */
export function follow(api, id, onProgress) {
  const path = `/api/jobs/${encodeURIComponent(id)}`;
  const result = (async () => {
    for (;;) {
      const job = await api.get(path);
      if (job.state === "done") return job.result;
      if (job.state === "cancelled") throw new Error("Cancelled");
      if (job.state === "failed") throw new Error(job.error);
      onProgress(job.progress);
      await new Promise((done) => setTimeout(done, EVERY_MS));
    }
  })();
  return { result, cancel: () => api.del(path) };
}
