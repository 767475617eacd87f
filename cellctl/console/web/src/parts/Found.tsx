// What was found in a mesh: mended or not, said in a word and a sign; a place can be shown on the part.
import type { Finding } from "../api/types";
import { words } from "../words";

const say = words.parts;

/** show: told the place to mark; null takes the mark away. */
export function Found({ findings, shown, show }: { findings: Finding[]; shown?: number | null; show?: (index: number | null) => void }) {
  if (findings.length === 0) return <p class="found-none tone-run">✓ {say.noFindings}</p>;
  return (
    <ul class="found">
      {findings.map((found, index) => (
        <li key={index}>
          <b class={`badge tone-${found.mended ? "run" : "fault"}`}>{found.mended ? `✓ ${say.mended}` : `▲ ${say.notMended}`}</b>
          <span class="grow">{found.text}</span>
          {found.place_mm && show && (
            <button type="button" class="small" aria-pressed={shown === index} onClick={() => show(shown === index ? null : index)}>
              {say.showPlace}
            </button>
          )}
        </li>
      ))}
    </ul>
  );
}
