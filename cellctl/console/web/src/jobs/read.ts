// A document of the service that is read again whenever something that it depends on changes.
import { useEffect, useState } from "preact/hooks";
import { get } from "../api/http";
import { told } from "../state/notices";

/** The document at a path (null: none is asked for), and a way to put a newer one in its place. */
export function useDocument<T>(path: string | null, depends: unknown): [T | null, (next: T) => void] {
  const [known, setKnown] = useState<{ path: string | null; document: T } | null>(null);
  useEffect(() => {
    if (path === null) return;
    const aborter = new AbortController();
    get<T>(path, aborter.signal).then(
      (document) => setKnown({ path, document }),
      (error) => aborter.signal.aborted || told(error),
    );
    return () => aborter.abort();
  }, [path, depends]);
  return [known?.path === path ? known.document : null, (document) => setKnown({ path, document })];
}
