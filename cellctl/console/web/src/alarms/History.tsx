// What was latched before, by incident: filters, pages, and the way to the trend of that moment.
import type { Incident } from "../api/types";
import { filter, hasMore, incidents, isReading, PERIODS, readOlder, type Period } from "../state/alarms";
import { showMoment } from "../state/history";
import { newestFirst } from "../state/jobs";
import { alarmWords } from "../state/told";
import { words } from "../words";
import { duration, moment } from "../words/format";
import { Followed, placeOf, seenText } from "./Alarms";

const say = words.alarmPage;

export function History() {
  return (
    <section class="panel alarm-history" aria-label={say.history}>
      <div class="panel-head">
        <h2>{say.history}</h2>
        <Filters />
      </div>
      {incidents.value.length === 0 && !isReading.value && <p class="muted">{say.noHistory}</p>}
      <ol>
        {incidents.value.map((incident) => (
          <Row key={incident.id} incident={incident} />
        ))}
      </ol>
      {hasMore.value && (
        <button type="button" class="control" disabled={isReading.value} onClick={readOlder}>
          {isReading.value ? say.working : say.older}
        </button>
      )}
    </section>
  );
}

/** Code and short name of every cause, in the order of the names. */
const CAUSES = Object.entries(say.causes).sort(([, one], [, other]) => one.localeCompare(other));

function Filters() {
  const change = (part: Partial<typeof filter.value>) => (filter.value = { ...filter.peek(), ...part });
  const ran = newestFirst.value.filter((job) => job.lines_executed > 0);
  return (
    <div class="row filters">
      <label>
        {say.code}
        <select value={filter.value.code} onChange={(event) => change({ code: event.currentTarget.value })}>
          <option value="">{say.allCodes}</option>
          {CAUSES.map(([code, cause]) => (
            <option key={code} value={code}>
              {cause}
            </option>
          ))}
        </select>
      </label>
      <label>
        {say.job}
        <select value={filter.value.job} onChange={(event) => change({ job: event.currentTarget.value })}>
          <option value="">{say.allJobs}</option>
          {ran.map((job) => (
            <option key={job.id} value={job.id}>
              {job.name}
            </option>
          ))}
        </select>
      </label>
      <label>
        {say.period}
        <select value={filter.value.period} onChange={(event) => change({ period: event.currentTarget.value as Period })}>
          {(Object.keys(PERIODS) as Period[]).map((name) => (
            <option key={name} value={name}>
              {say.periods[name]}
            </option>
          ))}
        </select>
      </label>
    </div>
  );
}

function Row({ incident }: { incident: Incident }) {
  const { first, followed, at, ended_at, duration_s, reset_by, because } = incident;
  const { cause, remedy } = alarmWords(first);
  return (
    <li class={`incident ${ended_at === null ? "is-latched" : ""}`}>
      <div class="incident-when">
        <time>{moment(at)}</time>
        <small>{ended_at === null ? say.latched : say.lasted(duration(duration_s))}</small>
      </div>
      <div class="incident-what">
        <b>{cause}</b>
        <small class="muted">
          {say.remedy}: {remedy}
        </small>
        {placeOf(incident) && <small class="muted">{placeOf(incident)}</small>}
        <Followed followed={followed} />
      </div>
      <div class="incident-who">
        <small>{seenText(incident)}</small>
        {ended_at !== null && <small>{say.reset(reset_by, moment(ended_at), because)}</small>}
      </div>
      <button type="button" class="control" onClick={() => showMoment(at)}>
        {say.trend}
      </button>
    </li>
  );
}
