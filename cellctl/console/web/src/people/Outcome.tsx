// What came of something that was asked: done, or refused with the reason.
import { useState } from "preact/hooks";
import { noticeOf, type Notice } from "../state/notices";

export interface Asking {
  busy: boolean;
  /** Do it; `done` is told when it worked. */
  ask: (work: () => Promise<string>) => void;
  shown: preact.JSX.Element | null;
}

export function useAsking(): Asking {
  const [busy, setBusy] = useState(false);
  const [done, setDone] = useState("");
  const [problem, setProblem] = useState<Notice | null>(null);
  const ask = (work: () => Promise<string>) => {
    setBusy(true);
    setDone("");
    setProblem(null);
    work()
      .then(setDone, (error: unknown) => setProblem(noticeOf(error)))
      .finally(() => setBusy(false));
  };
  const shown = problem ? (
    <p class="problem" role="alert">
      <b>{problem.title}</b> {problem.detail} {problem.hint}
    </p>
  ) : done ? (
    <p class="done" role="status">
      {done}
    </p>
  ) : null;
  return { busy, ask, shown };
}
