// The page "alarms": what is latched with its first cause, remedy and acknowledgement; below it the history.
import { useEffect } from "preact/hooks";
import type { AlarmTold, Incident } from "../api/types";
import { acknowledge, followAlarms, latched } from "../state/alarms";
import { dataAge } from "../state/cell";
import { showMoment } from "../state/history";
import { isOperator } from "../state/session";
import { alarmWords } from "../state/told";
import { trendNow } from "../state/trends";
import { words } from "../words";
import { duration, moment } from "../words/format";
import { History } from "./History";

const say = words.alarmPage;

export function Alarms() {
  useEffect(() => followAlarms(), []);
  return (
    <section class="alarm-page" aria-label={say.region}>
      {latched.value ? <Latched incident={latched.value} /> : <Nothing />}
      <History />
    </section>
  );
}

function Nothing() {
  return (
    <p class="panel nothing-latched">
      <i aria-hidden="true">✓</i> {say.none}
    </p>
  );
}

/** Where the job was. */
export function placeOf({ job, job_name, first }: Incident): string {
  const counted = (value: number | null) => (value === null || value < 0 ? "" : String(value + 1));
  return say.where(job_name || job, counted(first.layer), counted(first.line));
}

function Latched({ incident }: { incident: Incident }) {
  const { first, followed, at } = incident;
  const { cause, remedy } = alarmWords(first);
  void dataAge.value; // its age goes on
  return (
    <article class="panel latched">
      <h2>
        {say.active} <span class="badge">{first.code}</span>
      </h2>
      <p class="latched-cause">
        <small>{say.firstCause}</small>
        <strong>{cause}</strong>
      </p>
      <p>
        <b>{say.remedy}:</b> {remedy}
      </p>
      <p class="muted">
        {say.since(moment(at), duration(Math.max(trendNow() - at, 0)))}
        {placeOf(incident) && ` · ${placeOf(incident)}`}
        {first.instead_of.length > 0 && ` · ${say.instead(first.instead_of.join(", "))}`}
      </p>
      <Followed followed={followed} />
      <Seen incident={incident} />
    </article>
  );
}

export function Followed({ followed }: { followed: AlarmTold[] }) {
  if (followed.length === 0) return null;
  return (
    <div class="followed">
      <h3>{say.followed}</h3>
      <ol>
        {followed.map((one) => (
          <li key={one.seq}>
            <time>{moment(one.at)}</time> {alarmWords(one).cause} <span class="badge">{one.code}</span>
          </li>
        ))}
      </ol>
    </div>
  );
}

/** Who has seen it, by name. */
export function seenText({ first, followed }: Incident): string {
  const all = [first, ...followed];
  const seen = all.filter(({ acknowledged_by }) => acknowledged_by);
  const last = seen.at(-1);
  if (!last) return say.notSeen;
  const text = say.seen(last.acknowledged_by, moment(last.acknowledged_at ?? 0));
  return seen.length < all.length ? `${text}. ${say.seenSome}` : text;
}

function Seen({ incident }: { incident: Incident }) {
  const isSeen = [incident.first, ...incident.followed].every(({ acknowledged_by }) => acknowledged_by);
  return (
    <div class="row latched-row">
      {isSeen ? (
        <span class="seen">
          <i aria-hidden="true">✓</i> {seenText(incident)}
        </span>
      ) : (
        <button
          type="button"
          class="control primary"
          disabled={!isOperator.value}
          title={isOperator.value ? say.acknowledgeHint : say.operatorOnly}
          onClick={() => void acknowledge(incident.id)}
        >
          {say.acknowledge}
        </button>
      )}
      <button type="button" class="control" onClick={() => showMoment(incident.at)}>
        {say.trend}
      </button>
      <span class="muted">{isSeen ? say.resetHint : say.acknowledgeHint}</span>
    </div>
  );
}
