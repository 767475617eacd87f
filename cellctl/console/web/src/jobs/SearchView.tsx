// All jobs, newest first, or those that fit what a person looks for.
import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { get } from "../api/http";
import type { Job, Page } from "../api/types";
import { jobs, newestFirst } from "../state/jobs";
import { told } from "../state/notices";
import { words } from "../words";
import { Entry } from "./Entry";
import { useDocument } from "./read";

const say = words.jobs;
const PAUSE_MS = 250; // after the last key, before it is looked for
const asked = signal({ text: "", state: "", tag: "" });

export function SearchView() {
  const { text, state, tag } = asked.value;
  const isAsked = Boolean(text.trim() || state || tag);
  const [found, more] = useFound(isAsked ? asked.value : null);
  const shown = isAsked ? (found?.items ?? []).map((job) => jobs.value.get(job.id) ?? job) : newestFirst.value;
  return (
    <>
      <Filters />
      {shown.length === 0 && (!isAsked || found) && <p class="muted">{isAsked ? say.found : say.none}</p>}
      <ul class="job-list">
        {shown.map((job) => (
          <li key={job.id}>
            <Entry job={job} />
          </li>
        ))}
      </ul>
      {found?.next && isAsked && (
        <button type="button" class="control" onClick={more}>
          {say.more}
        </button>
      )}
    </>
  );
}

function Filters() {
  const [tags] = useDocument<{ items: Record<string, number> }>("/tags", jobs.value.size);
  const change = (name: "text" | "state" | "tag") => (event: Event) =>
    (asked.value = { ...asked.value, [name]: (event.currentTarget as HTMLInputElement | HTMLSelectElement).value });
  return (
    <form class="job-filters" role="search" onSubmit={(event) => event.preventDefault()}>
      <label class="wide">
        {say.search}
        <input type="search" maxLength={200} placeholder={say.searchHint} value={asked.value.text} onInput={change("text")} />
      </label>
      <label>
        {say.state}
        <select value={asked.value.state} onChange={change("state")}>
          <option value="">{say.anyState}</option>
          {Object.entries(say.states).map(([state, label]) => (
            <option key={state} value={state}>
              {label}
            </option>
          ))}
        </select>
      </label>
      <label>
        {say.tag}
        <select value={asked.value.tag} onChange={change("tag")}>
          <option value="">{say.anyTag}</option>
          {Object.entries(tags?.items ?? {}).map(([tag, count]) => (
            <option key={tag} value={tag}>
              {tag} ({count})
            </option>
          ))}
        </select>
      </label>
    </form>
  );
}

/** What was found, page by page; nothing while nothing is asked. */
function useFound(wanted: { text: string; state: string; tag: string } | null): [Page<Job> | null, () => void] {
  const [found, setFound] = useState<Page<Job> | null>(null);
  const query = wanted && new URLSearchParams(Object.entries(wanted).filter(([, value]) => value.trim())).toString();
  useEffect(() => {
    if (query === null) return setFound(null);
    const aborter = new AbortController();
    const timer = setTimeout(() => {
      get<Page<Job>>(`/jobs?${query}`, aborter.signal).then(setFound, (error) => aborter.signal.aborted || told(error));
    }, PAUSE_MS);
    return () => {
      clearTimeout(timer);
      aborter.abort();
    };
  }, [query, jobs.value.size]);
  const more = () => {
    if (!found?.next) return;
    get<Page<Job>>(`/jobs?${query}&cursor=${encodeURIComponent(found.next)}`).then(
      (page) => setFound({ items: [...found.items, ...page.items], next: page.next ?? null } as Page<Job>),
      told,
    );
  };
  return [found, more];
}
