// All parts with small pictures, found by name, and the place to drop new ones.
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/base";
import { get } from "../api/http";
import type { Page, Part } from "../api/types";
import { noticeOf, type Notice } from "../state/notices";
import { words } from "../words";
import type { Box } from "./measured";
import { Problem } from "./Problem";
import { addressOf, go, type Route } from "./route";
import { sizeText } from "./sizes";
import { Upload } from "./Upload";

const say = words.parts;
const LISTED = 100;

export function PartList() {
  const [parts, setParts] = useState<Part[]>([]);
  const [next, setNext] = useState<string | null>(null);
  const [problem, setProblem] = useState<Notice | null>(null);
  const [wanted, setWanted] = useState("");
  const read = (cursor: string | null) =>
    get<Page<Part>>(`/parts?limit=${LISTED}${cursor ? `&cursor=${encodeURIComponent(cursor)}` : ""}`).then(
      (page) => {
        setParts((before) => (cursor ? [...before, ...page.items] : page.items));
        setNext(page.next);
      },
      (error) => setProblem(noticeOf(error)),
    );
  useEffect(() => void read(null), []);
  const found = parts.filter((part) => part.name.toLowerCase().includes(wanted.trim().toLowerCase()));
  return (
    <div class="parts">
      <Upload done={() => void read(null)} />
      <section class="part-list" aria-label={say.all}>
        <div class="panel-head">
          <h2 class="parts-title">{say.all}</h2>
          <label class="search">
            <span class="hidden-word">{say.search}</span>
            <input type="search" placeholder={say.search} value={wanted} onInput={(event) => setWanted(event.currentTarget.value)} />
          </label>
        </div>
        <Problem of={problem} />
        {found.length === 0 && <p class="muted">{parts.length ? say.noneFound : say.none}</p>}
        <ul class="cards">
          {found.map((part) => (
            <Card key={part.id} part={part} />
          ))}
        </ul>
        {next && (
          <button type="button" class="control" onClick={() => void read(next)}>
            {say.more}
          </button>
        )}
      </section>
    </div>
  );
}

function Card({ part }: { part: Part }) {
  const to: Route = { view: "part", part: part.id, like: null };
  const [low = [], high = []] = part.bbox_mm;
  const box = [0, 1, 2].map((k) => (high[k] ?? 0) - (low[k] ?? 0)) as Box;
  const open = part.findings.filter((found) => !found.mended).length;
  return (
    <li>
      <a
        class="card"
        href={addressOf(to)}
        onClick={(event) => {
          event.preventDefault();
          go(to);
        }}
      >
        <img src={`${api}/parts/${encodeURIComponent(part.id)}/thumbnail`} alt="" width={120} height={90} loading="lazy" />
        <span class="card-text">
          <b>{part.name}</b>
          <span class="muted">{sizeText(box, 1)}</span>
          {open > 0 ? <span class="tone-fault">▲ {say.open(open)}</span> : part.findings.length > 0 && <span class="tone-run">✓ {say.allMended}</span>}
        </span>
      </a>
    </li>
  );
}
