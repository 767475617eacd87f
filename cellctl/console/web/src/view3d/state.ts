// What the view shows: which layer, live or scrubbed or by hand, in which colours. Kept apart from how it is drawn.
import { computed, effect, signal } from "@preact/signals";
import { get } from "../api/http";
import type { ProofDocument, ProofFinding } from "../api/types";
import { snapshot } from "../state/cell";
import { shown } from "../state/jobs";
import { operations, plan } from "../state/plan";
import type { Quantity } from "./path_material";
import type { Moment, TrackIndex } from "./track";

export type Mode = "live" | "scrub" | "layer";
export const RATES = [1, 10, 100] as const;

export const mode = signal<Mode>("live");
export const layerByHand = signal(0);
export const scrubTime = signal(0);
/** The line (from 0) at whose end the scrubbed moment is, -1: it is at a time. */
export const scrubLine = signal(-1);
export const rate = signal<number>(10);
export const isPlaying = signal(false);
export const quantity = signal<Quantity>("process");
export const withBelow = signal(true);
export const withPart = signal(true);
export const withMetal = signal(true);
export const withMachine = signal(false);
export const withFindings = signal(false);
export const chosenFinding = signal(-1);

/** The program by time, null where there is none (yet). */
export const track = signal<TrackIndex | null>(null);
/** Where the scrubbed or running program is, as far as its lines are here. */
export const moment = signal<Moment | null>(null);
export const findings = signal<ProofFinding[]>([]);

export const layerCount = computed(() => plan.value?.plan.layers.length ?? 0);

/** The job on the cell if it is the one that is shown and still runs. */
export const onCell = computed(() => {
  const job = snapshot.value?.job;
  return job && job.id === plan.value?.job && !job.outcome ? job : null;
});
const isOnCell = computed(() => onCell.value !== null);
export const placeOnCell = computed(() => (onCell.value ? operations.value[onCell.value.operation] : undefined));

/** What is really shown: live only while the job is on the cell. */
export const shownMode = computed<Mode>(() => (mode.value === "live" && !isOnCell.value ? "layer" : mode.value));

export const layer = computed(() => {
  const last = Math.max(0, layerCount.value - 1);
  if (shownMode.value === "live") return Math.min(placeOnCell.value?.layer ?? onCell.value?.layer ?? 0, last);
  if (shownMode.value === "scrub") return Math.min(Math.max(0, moment.value?.layer ?? layerAt(scrubTime.value)), last);
  return Math.min(Math.max(0, layerByHand.value), last);
});

/** Layer of a program's time. */
export function layerAt(time: number): number {
  const chunks = track.value?.chunks ?? [];
  const found = chunks.find((chunk) => chunk.time_end_s >= time) ?? chunks.at(-1);
  return Math.max(0, found?.layer ?? 0);
}

export function scrubTo(time: number): void {
  mode.value = "scrub";
  scrubLine.value = -1;
  scrubTime.value = Math.min(Math.max(0, time), track.value?.duration_s ?? 0);
}

/** Show the end of a line, from 0; the nearest there is. */
export function scrubToLine(line: number): void {
  isPlaying.value = false;
  mode.value = "scrub";
  scrubLine.value = Math.min(Math.max(0, line), (track.value?.lines ?? 1) - 1);
}

export function showLayer(number: number): void {
  isPlaying.value = false;
  layerByHand.value = number;
  mode.value = "layer";
}

export function goLive(): void {
  isPlaying.value = false;
  mode.value = "live";
}

const proofKey = computed(() => {
  const job = shown.value;
  return job?.proof_sha256 ? `${job.id} ${job.proof_sha256}` : "";
});

/** Read the findings of the shown job's proof; again when it has another. */
export function followFindings(): () => void {
  return effect(() => {
    const key = proofKey.value;
    findings.value = [];
    chosenFinding.value = -1;
    const [job] = key.split(" ");
    if (!job) return;
    get<ProofDocument>(`/jobs/${job}/proof`).then(
      (proof) => {
        if (proofKey.peek() === key) findings.value = proof.findings;
      },
      () => undefined, // the job's page says what is wrong with its proof
    );
  });
}
