// The audit trail: who did what, from where and why; what people and machines wrote stands there as text.
import { useEffect, useState } from "preact/hooks";
import { words } from "../words";
import { useAsking } from "./Outcome";
import { readTrail, verifyTrail, type Deed } from "./state";

const say = words.people.trail;
const FIELDS = ["who", "verb", "target"] as const;

export function Trail() {
  const [deeds, setDeeds] = useState<Deed[] | null>(null);
  const [next, setNext] = useState<string | null>(null);
  const [asked, setAsked] = useState<Record<string, string>>({});
  const { busy, ask, shown } = useAsking();
  const read = (wanted: Record<string, string>, before: Deed[]) =>
    ask(async () => {
      const page = await readTrail(wanted);
      setDeeds([...before, ...page.items]);
      setNext(page.next);
      return "";
    });
  useEffect(() => read({}, []), []);
  const filter = (event: SubmitEvent) => {
    event.preventDefault();
    const given = new FormData(event.currentTarget as HTMLFormElement);
    const wanted = Object.fromEntries(FIELDS.map((name) => [name, String(given.get(name) ?? "").trim()]));
    setAsked(wanted);
    read(wanted, []);
  };
  const verify = () =>
    ask(async () => {
      const verdict = await verifyTrail();
      if (verdict.fault) throw new Error(say.changed(verdict.fault));
      return say.fits(verdict.rows, verdict.head);
    });
  return (
    <>
      <form onSubmit={filter}>
        <div class="row">
          <label>
            {say.filterWho}
            <input name="who" maxLength={200} />
          </label>
          <label>
            {say.filterVerb}
            <input name="verb" maxLength={200} />
          </label>
          <label>
            {say.filterTarget}
            <input name="target" maxLength={200} />
          </label>
          <button type="submit" class="control" disabled={busy}>
            {say.show}
          </button>
          <button type="button" class="control" disabled={busy} onClick={verify}>
            {say.verify}
          </button>
        </div>
      </form>
      {shown}
      {deeds?.length === 0 && <p class="muted">{say.none}</p>}
      {deeds && deeds.length > 0 && <Deeds deeds={deeds} />}
      {next && (
        <div>
          <button type="button" class="control" disabled={busy} onClick={() => read({ ...asked, cursor: next }, deeds ?? [])}>
            {words.people.more}
          </button>
        </div>
      )}
    </>
  );
}

function Deeds({ deeds }: { deeds: Deed[] }) {
  return (
    <table>
      <thead>
        <tr>
          <th>{say.time}</th>
          <th>{say.who}</th>
          <th>{say.origin}</th>
          <th>{say.verb}</th>
          <th>{say.target}</th>
          <th>{say.why}</th>
          <th>{say.outcome}</th>
        </tr>
      </thead>
      <tbody>
        {deeds.map((deed) => (
          <tr key={deed.seq}>
            <td class="narrow">{new Date(deed.at * 1000).toLocaleString()}</td>
            <td>{deed.who}</td>
            <td class="narrow">{deed.origin}</td>
            <td>{deed.verb}</td>
            <td>{deed.target}</td>
            <td>{deed.because}</td>
            <td>{deed.outcome}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
