// The plan of the job that is shown, and the facts of the cell.
import { computed, effect, signal } from "@preact/signals";
import { get } from "../api/http";
import type { CellFacts, Plan } from "../api/types";
import { shown } from "./jobs";
import { told } from "./notices";
import { session } from "./session";

export interface PlanOfJob {
  job: string;
  sha256: string;
  part: string;
  plan: Plan;
}

export interface OperationPlace {
  layer: number;
  index: number; // within the layer
  process: string;
}

export const plan = signal<PlanOfJob | null>(null);
export const facts = signal<CellFacts | null>(null);

/** Every operation of the plan in order: the cell counts them over the whole plan. */
export const operations = computed<OperationPlace[]>(() =>
  (plan.value?.plan.layers ?? []).flatMap((layer, number) =>
    layer.operations.map(({ process }, index) => ({ layer: number, index, process })),
  ),
);

const wanted = computed(() => {
  const job = shown.value;
  return session.value && job?.plan_sha256 ? `${job.id} ${job.plan_sha256} ${job.part_id}` : "";
});

/** Keep `plan` and `facts` in step with the job that is shown and with the session. */
export function followPlan(): void {
  effect(() => void load(wanted.value));
  effect(() => {
    if (session.value) get<CellFacts>("/cell/facts").then((found) => (facts.value = found), told);
  });
}

async function load(key: string): Promise<void> {
  const [job, sha256, part] = key.split(" ");
  if (!job || !sha256 || !part) {
    plan.value = null;
    return;
  }
  if (plan.peek()?.sha256 === sha256 && plan.peek()?.job === job) return;
  try {
    const found = await get<Plan>(`/jobs/${job}/plan`);
    if (wanted.peek() === key) plan.value = { job, sha256, part, plan: found };
  } catch (error) {
    told(error);
  }
}
