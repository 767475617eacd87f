// What happened, newest first.
import { events } from "../state/cell";
import { words } from "../words";
import { clock } from "../words/format";

const say = words.log;

export function EventLog() {
  return (
    <section class="panel log" aria-label={say.title}>
      <h2>{say.title}</h2>
      {events.value.length === 0 && <p class="muted">{say.none}</p>}
      <ol>
        {events.value.map((event) => (
          <li key={event.seq} class={event.kind === "alarm" ? "event is-alarm" : "event"}>
            <time>{clock(event.at)}</time>
            <b>{say.kinds[event.kind] ?? event.kind}</b>
            <span>{event.text}</span>
          </li>
        ))}
      </ol>
    </section>
  );
}
