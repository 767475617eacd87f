// A job that goes on with another: the generated program to be read, with its figures.
import { useEffect, useState } from "preact/hooks";
import { get } from "../api/http";
import type { Job, ProgramHead } from "../api/types";
import { told } from "../state/notices";
import { words } from "../words";
import { duration, fixed, whole } from "../words/format";
import { Other } from "./GoOn";

const say = words.goOn;

export function Rest({ job }: { job: Job }) {
  const [head, setHead] = useState<ProgramHead | null>(null);
  useEffect(() => {
    if (!job.continues_job || !job.program_sha256) return;
    const aborter = new AbortController();
    get<ProgramHead>(`/jobs/${job.id}/program/head`, aborter.signal).then(setHead, (error) => aborter.signal.aborted || told(error));
    return () => aborter.abort();
  }, [job.id, job.program_sha256]);
  if (!job.continues_job) return null;
  const figures = job.resumption;
  return (
    <section class="panel generated">
      <h2>{say.program}</h2>
      <Other label={say.continues} id={job.continues_job} />
      {figures && (
        <dl class="pairs stacked">
          {Object.entries(say.figures).map(([name, label]) => (
            <div key={name}>
              <dt>{label}</dt>
              <dd>{name.endsWith("_s") ? duration(figures[name] ?? 0) : `${fixed(figures[name] ?? 0, 2)} mm`}</dd>
            </div>
          ))}
          <div>
            <dt>{say.remaining}</dt>
            <dd>{say.remains(whole(figures.remaining_lines ?? 0), whole(figures.remaining_operations ?? 0), whole(figures.remaining_layers ?? 0))}</dd>
          </div>
        </dl>
      )}
      {head && figures && <Text head={head} from={whole(figures.resumed_line ?? 0)} />}
    </section>
  );
}

function Text({ head, from }: { head: ProgramHead; from: string }) {
  return (
    <>
      <p class="muted">{say.programHint}</p>
      <ol class="program" tabIndex={0} aria-label={say.program}>
        {head.lines.map((line, index) => (
          <li key={index} class={kindOf(line, index >= head.head_lines)}>
            {index === head.head_lines && <span class="joint">{say.joint(from)}</span>}
            {line}
          </li>
        ))}
      </ol>
    </>
  );
}

function kindOf(line: string, isOriginal: boolean): string {
  return isOriginal ? "original" : /^N\d+ \(/.test(line) ? "remark" : "";
}
