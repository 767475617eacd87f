// What lies on the cell's table, and a person's word that it is clear.
import { useState } from "preact/hooks";
import { post } from "../api/http";
import type { TableState } from "../api/types";
import { jobs } from "../state/jobs";
import { told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { moment } from "../words/format";
import { useDocument } from "./read";

const say = words.jobs;

function standing(table: TableState): string {
  if (table.job) return (table.state === "running" || table.state === "held" ? say.tableRuns : say.tableOn)(table.name);
  return table.cleared_at ? say.tableCleared(table.cleared_by, moment(table.cleared_at)) : say.tableUnknown;
}

export function TablePanel() {
  const depends = [...jobs.value.values()].map((job) => `${job.state}${job.table_clear}${job.cleared_at}${job.priority}/${job.rank}${job.after.length}${job.not_before}`).join();
  const [table, setTable] = useDocument<TableState>("/table", depends);
  const [hasLooked, setLooked] = useState(false);
  const [busy, setBusy] = useState(false);
  if (!table) return null;
  const isInUse = table.state === "running" || table.state === "held";
  const clear = async (start: string | null) => {
    setBusy(true);
    try {
      setTable(await post<TableState>("/table/clear", { because: say.tableBecause, ...(start ? { start } : {}) }));
      setLooked(false);
    } catch (error) {
      told(error);
    } finally {
      setBusy(false);
    }
  };
  return (
    <section class="panel table-panel">
      <h2>{say.table}</h2>
      <p>
        <b>{standing(table)}</b>
      </p>
      <p class="muted">{say.tableRule}</p>
      {!isInUse && (
        <>
          <label class="check">
            <input type="checkbox" checked={hasLooked} disabled={!isOperator.value} onChange={(event) => setLooked(event.currentTarget.checked)} />
            <span>{say.tableLooked}</span>
          </label>
          <div class="row">
            <button type="button" class="control" disabled={!hasLooked || busy} onClick={() => void clear(null)}>
              {say.tableConfirm}
            </button>
            {table.next && (
              <button type="button" class="control primary" disabled={!hasLooked || busy} onClick={() => void clear(table.next)}>
                {say.tableStart(table.next_name)}
              </button>
            )}
          </div>
        </>
      )}
    </section>
  );
}
