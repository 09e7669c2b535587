// Work in the background of the server: its progress, its result, an end before it is done.

const EVERY_MS = 250;

/** Follow a job that the server has been asked for; `posted`: the promise of its answer. {id, result: promises, cancel()}:
 * the result rejects with the server's reason, or when the job is cancelled, also before the server has answered. */
export function follow(api, posted, onProgress) {
  const id = posted.then((answer) => answer.job);
  const path = id.then((name) => `/api/jobs/${encodeURIComponent(name)}`);
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
  const cancel = () => path.then((there) => api.del(there)).catch(() => {}); // it has ended meanwhile, or never begun
  return { id, result, cancel };
}
