// The queue in its order: what each job waits for, and a way to move it by finger or key; the table before it.
import { useState } from "preact/hooks";
import { post } from "../api/http";
import type { Job, Queue } from "../api/types";
import { jobs } from "../state/jobs";
import { told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { whole } from "../words/format";
import { Entry } from "./Entry";
import { useDocument } from "./read";
import { TablePanel } from "./TablePanel";
import { Waits } from "./Waits";

const say = words.jobs;
type Lane = "cell" | "planning";

export function QueueView() {
  return (
    <>
      <TablePanel />
      <LaneList lane="cell" title={say.queue} />
      <LaneList lane="planning" title={say.planning} />
    </>
  );
}

/** Jobs that wait in a lane; changes whenever one of them does. */
function standing(state: string): string {
  return [...jobs.value.values()].map((job) => (job.state === state ? `${job.id} ${job.why} ${job.priority}/${job.rank}` : "")).join();
}

function LaneList({ lane, title }: { lane: Lane; title: string }) {
  const [heard, setHeard] = useState("");
  const [again, setAgain] = useState(0);
  const [queue, setQueue] = useDocument<Queue>(`/queue?lane=${lane}&limit=100`, `${standing(lane === "cell" ? "queued" : "submitted")} ${again}`);
  if (!queue || (lane === "planning" && queue.length === 0)) return null;
  const move = async (job: Job, to: "up" | "down" | "first", button: HTMLElement) => {
    try {
      const body = { job: job.id, to, version: queue.version, because: say.movedBecause };
      const next = await post<Queue>(`/queue/move?lane=${lane}&limit=100`, body);
      setQueue(next);
      setHeard(say.moved(job.name, whole(next.items.findIndex(({ id }) => id === job.id) + 1)));
      requestAnimationFrame(() => button.isConnected && button.focus()); // it moved with its job
    } catch (error) {
      told(error);
      setAgain(again + 1);
    }
  };
  return (
    <section>
      <h2>{title}</h2>
      {queue.length === 0 && <p class="muted">{say.queueEmpty}</p>}
      <ol class="job-queue">
        {queue.items.map((job, k) => (
          <li key={job.id}>
            <span class="queue-position">{say.position(whole(k + 1))}</span>
            <div class="queue-job">
              <Entry job={job} withNote={false} />
              <Waits job={job} />
            </div>
            <Moves job={job} isFirst={k === 0} isLast={k === queue.length - 1} move={(to, button) => void move(job, to, button)} />
          </li>
        ))}
      </ol>
      <p class="hidden-word" role="status">
        {heard}
      </p>
    </section>
  );
}

interface MovesGiven {
  job: Job;
  isFirst: boolean;
  isLast: boolean;
  move: (to: "up" | "down" | "first", button: HTMLElement) => void;
}

function Moves({ job, isFirst, isLast, move }: MovesGiven) {
  const ways = [
    ["first", "⤒", say.first(job.name), isFirst],
    ["up", "↑", say.up(job.name), isFirst],
    ["down", "↓", say.down(job.name), isLast],
  ] as const;
  return (
    <div class="queue-moves">
      {ways.map(([to, sign, label, isAtEnd]) => (
        <button type="button" class="control" key={to} aria-label={label} aria-disabled={isAtEnd} disabled={!isOperator.value} onClick={(event) => !isAtEnd && move(to, event.currentTarget)}>
          <span aria-hidden="true">{sign}</span>
        </button>
      ))}
    </div>
  );
}
