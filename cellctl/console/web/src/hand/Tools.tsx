// The tool table: length, diameter and wear as measured, beside the cell file's.
import { useEffect, useState } from "preact/hooks";
import { get, newKey, send } from "../api/http";
import { mayCommand, whyNot } from "../state/control";
import { told } from "../state/notices";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.hand;

interface ToolRow {
  number: number;
  name: string;
  filed_length_mm: number;
  filed_diameter_mm: number;
  length_mm: number;
  diameter_mm: number;
  length_wear_mm: number;
  diameter_wear_mm: number;
  measured: boolean;
}

const FIELDS = ["length_mm", "diameter_mm", "length_wear_mm", "diameter_wear_mm"] as const;

export function Tools() {
  const [rows, setRows] = useState<ToolRow[]>([]);
  const [edited, setEdited] = useState<ToolRow | null>(null);
  const read = () => get<ToolRow[]>("/cell/tools").then(setRows, told);
  useEffect(() => void read(), []);
  return (
    <section class="panel tools">
      <h2>{say.tools}</h2>
      <table class="tool-table">
        <thead>
          <tr>
            <th scope="col">{say.tool}</th>
            {FIELDS.map((name) => (
              <th scope="col" key={name}>
                {say.toolFields[name]}
              </th>
            ))}
            <th />
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr key={row.number}>
              <th scope="row">
                T{row.number} {row.name} {row.measured && <span class="badge">{say.isMeasured}</span>}
              </th>
              {FIELDS.map((name) => (
                <td key={name}>{fixed(row[name], 3)}</td>
              ))}
              <td>
                <button type="button" class="control" title={whyNot.value} aria-label={say.editTool(row.number)} disabled={!mayCommand.value} onClick={() => setEdited(row)}>
                  {say.edit}
                </button>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {edited && <Edit key={edited.number} row={edited} close={() => setEdited(null)} done={() => void read()} />}
    </section>
  );
}

function Edit({ row, close, done }: { row: ToolRow; close: () => void; done: () => void }) {
  const save = (event: SubmitEvent) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement);
    const body = Object.fromEntries(FIELDS.map((name) => [name, Number(form.get(name))]));
    send("PUT", `/cell/tools/${row.number}`, { ...body, id: newKey("tool"), because: String(form.get("because") ?? "") }).then(() => {
      done();
      close();
    }, told);
  };
  return (
    <form class="tool-edit" onSubmit={save}>
      <h3>{say.editTool(row.number)}</h3>
      <p class="muted">{say.filed(fixed(row.filed_length_mm, 3), fixed(row.filed_diameter_mm, 3))}</p>
      <div class="row">
        {FIELDS.map((name) => (
          <label key={name}>
            {say.toolFields[name]}
            <input name={name} type="number" step="0.001" min="0" required defaultValue={String(row[name])} />
          </label>
        ))}
      </div>
      <div class="row">
        <label class="grow">
          {say.because}
          <input name="because" required maxLength={500} />
        </label>
        <button type="button" class="control" onClick={close}>
          {say.cancel}
        </button>
        <button type="submit" class="control primary" disabled={!mayCommand.value}>
          {say.save}
        </button>
      </div>
    </form>
  );
}
