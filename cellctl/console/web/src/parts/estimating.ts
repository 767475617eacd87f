// The estimate that goes with a recipe: asked a moment after the last change; the newest wins, older questions are given up.
import { useEffect, useState } from "preact/hooks";
import { checked } from "../api/http";
import { noticeOf, type Notice } from "../state/notices";
import type { Estimate } from "./documents";

const PAUSE_MS = 250;

export interface Estimating {
  estimate: Estimate | null; // the last that was answered
  before: Estimate | null; // the one before it
  problem: Notice | null;
  isBusy: boolean; // what is shown is not of the recipe as it stands
}

/** recipe: null asks nothing, as something in it is out of bounds. */
export function useEstimate(part: string, recipe: Record<string, unknown> | null): Estimating {
  const [state, setState] = useState<Estimating>({ estimate: null, before: null, problem: null, isBusy: true });
  const body = recipe && JSON.stringify({ recipe });
  useEffect(() => {
    setState((old) => ({ ...old, isBusy: true }));
    if (!body) return;
    const aborter = new AbortController();
    const ask = async () => {
      const headers = { "Content-Type": "application/json" };
      const answer = await checked(`/parts/${part}/estimate`, { method: "POST", headers, body, signal: aborter.signal });
      const estimate = (await answer.json()) as Estimate;
      if (!aborter.signal.aborted) setState((old) => ({ estimate, before: old.estimate, problem: null, isBusy: false }));
    };
    const fail = (error: unknown) => {
      if (!aborter.signal.aborted) setState((old) => ({ ...old, problem: noticeOf(error), isBusy: false }));
    };
    const timer = setTimeout(() => void ask().catch(fail), PAUSE_MS);
    return () => {
      clearTimeout(timer);
      aborter.abort();
    };
  }, [part, body]);
  return state;
}
