// What the twin found wrong: what, where, how deep, how often, and what would help.
import type { ProofFinding } from "../api/types";
import { words } from "../words";
import { fixed, whole } from "../words/format";

const say = words.jobs;

function where(found: ProofFinding): string {
  const parts: string[] = [];
  if (found.line > 0) parts.push(say.foundLine(String(found.line)));
  if (found.layer >= 0) parts.push(say.foundLayer(whole(found.layer)));
  if (found.operation >= 0) parts.push(say.foundOperation(whole(found.operation)));
  if (found.at_mm) parts.push(say.foundAt(fixed(found.at_mm[0], 2), fixed(found.at_mm[1], 2), fixed(found.at_mm[2], 2)));
  if (found.depth_mm > 0) parts.push(say.foundDepth(fixed(found.depth_mm, 2)));
  if (found.count > 1) parts.push(say.foundCount(whole(found.count)));
  return parts.join(" · ");
}

export function Findings({ findings }: { findings: ProofFinding[] }) {
  if (findings.length === 0) return null;
  const ranked = [...findings.filter((found) => found.severity === "error"), ...findings.filter((found) => found.severity !== "error")];
  return (
    <>
      <h3>{say.proofFindings}</h3>
      <ul class="proof-findings">
        {ranked.map((found, i) => (
          <li key={i}>
            <b class={`tone-${found.severity === "error" ? "fault" : "hold"}`}>{say.severities[found.severity] ?? found.severity}</b> <b>{found.kind}</b>: {found.text}
            <span class="muted">{where(found)}</span>
            {found.help && (
              <span>
                {say.foundHelp} {found.help}
              </span>
            )}
          </li>
        ))}
      </ul>
    </>
  );
}
