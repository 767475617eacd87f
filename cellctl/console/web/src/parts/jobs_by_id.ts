// A job by its id: as the live feed has it, else read once.
import { useEffect, useState } from "preact/hooks";
import { get } from "../api/http";
import type { Job } from "../api/types";
import { jobs, takeJob } from "../state/jobs";
import { noticeOf, type Notice } from "../state/notices";

export function useJob(id: string): { job: Job | null; problem: Notice | null } {
  const [problem, setProblem] = useState<Notice | null>(null);
  const job = jobs.value.get(id) ?? null;
  useEffect(() => {
    if (jobs.peek().has(id)) return;
    const aborter = new AbortController();
    get<Job>(`/jobs/${id}`, aborter.signal).then(takeJob, (error) => aborter.signal.aborted || setProblem(noticeOf(error)));
    return () => aborter.abort();
  }, [id]);
  return { job, problem };
}
