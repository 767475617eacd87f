// Jobs as they are known here, and which one is looked at.
import { computed, signal } from "@preact/signals";
import { get } from "../api/http";
import type { Job, Page } from "../api/types";
import { snapshot } from "./cell";
import { hereCell, isShared } from "./fleet";

const LISTED = 50;

export const jobs = signal<ReadonlyMap<string, Job>>(new Map());

/** Whether a job belongs on the page of this cell: it is this cell's, or no cell was chosen for it yet. */
function isHere(job: Job): boolean {
  return !isShared.value || job.cell === "" || job.cell === hereCell.value;
}

export const newestFirst = computed(() => [...jobs.value.values()].filter(isHere).sort((a, b) => b.created_at - a.created_at));

/** The job that a person opened, null if none. */
export const chosen = signal<string | null>(null);

/** The job whose plan is drawn: the opened one, else the one on the cell, else the newest with a plan. */
export const shown = computed<Job | null>(() => {
  const all = jobs.value;
  const onCell = snapshot.value?.job?.id;
  const wanted = all.get(chosen.value ?? "") ?? all.get(onCell ?? "");
  return wanted ?? newestFirst.value.find((job) => job.plan_sha256) ?? null;
});

/** A job as it is now. */
export function takeJob(job: Job): void {
  const next = new Map(jobs.peek());
  next.set(job.id, job);
  jobs.value = next;
}

/** Read the newest jobs. Raises RequestError. */
export async function readJobs(): Promise<void> {
  const page = await get<Page<Job>>(`/jobs?limit=${LISTED}`);
  const next = new Map(jobs.peek());
  for (const job of page.items) next.set(job.id, job);
  jobs.value = next;
}

/** The first in the queue whose table nobody has confirmed and that waits for nothing else, and the oldest that waits for approval. */
export const waiting = computed(() => {
  const oldestFirst = [...newestFirst.value].reverse();
  const inOrder = oldestFirst.filter((job) => job.waits_for.every(({ kind }) => kind === "table")).sort((a, b) => a.priority - b.priority || a.rank - b.rank);
  return {
    table: inOrder.find((job) => job.state === "queued" && !job.table_clear),
    approval: oldestFirst.find((job) => job.state === "waiting_for_approval"),
  };
});
