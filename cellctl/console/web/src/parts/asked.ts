// A document that is read when a component shows it, and again when its path changes; null until it is there.
import { useEffect, useState } from "preact/hooks";
import { get } from "../api/http";
import { noticeOf, type Notice } from "../state/notices";

export interface Asked<T> {
  found: T | null;
  problem: Notice | null;
}

/** path: null asks nothing. */
export function useAsked<T>(path: string | null): Asked<T> {
  const [state, setState] = useState<Asked<T> & { path: string | null }>({ found: null, problem: null, path: null });
  useEffect(() => {
    if (!path) return;
    const aborter = new AbortController();
    get<T>(path, aborter.signal).then(
      (found) => setState({ found, problem: null, path }),
      (error) => aborter.signal.aborted || setState({ found: null, problem: noticeOf(error), path }),
    );
    return () => aborter.abort();
  }, [path]);
  return state.path === path ? state : { found: null, problem: null };
}
