// How the plan divides the part: pieces, set-ups, and the ways to build it that were weighed.
import type { Plan, Subcomponent } from "../api/types";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.jobs;

export function Pieces({ plan }: { plan: Plan }) {
  const pieces = plan.subcomponents ?? [];
  if (pieces.length === 0) return null;
  return (
    <section class="panel pieces">
      {pieces.length > 1 && (
        <>
          <h2>{say.pieces}</h2>
          {(plan.setups ?? []).map((setup, number) => (
            <div key={number}>
              <h3>{say.setup(setup.turn, setup.subcomponents.map((k) => pieces[k]?.name).join(", "))}</h3>
              <ul class="texts">
                {setup.subcomponents.map((k) => (
                  <li key={k}>{pieces[k] && <Piece piece={pieces[k]} on={pieces[pieces[k].parent]?.name} />}</li>
                ))}
              </ul>
            </div>
          ))}
        </>
      )}
      <Ways plan={plan} />
    </section>
  );
}

function Piece({ piece, on }: { piece: Subcomponent; on: string | undefined }) {
  const facts = [
    say.piece(piece.name, on ? say.pieceOn(on) : say.plate, piece.layers[0] + 1, piece.layers[1]),
    piece.overhang_mm2 > 0 && say.overhang(fixed(piece.overhang_mm2, 1), fixed(piece.unsupported_mm, 1)),
    piece.support_mm3 > 0 && say.support(fixed(piece.support_mm3, 0)),
  ];
  return (
    <>
      {facts.filter(Boolean).join("; ")}
      {piece.why.map((reason) => (
        <span class="muted piece-why" key={reason}>
          {reason}
        </span>
      ))}
    </>
  );
}

function Ways({ plan }: { plan: Plan }) {
  const ways = plan.candidates ?? [];
  if (ways.length === 0) return null;
  return (
    <>
      <h3>{say.ways}</h3>
      <ul class="texts">
        {ways.map((way, number) => (
          <li key={number} class={way.chosen ? "" : "muted"}>
            {way.chosen && <b>{say.wayChosen} </b>}
            {say.way(way.name, fixed(100 * (way.buildable ?? Number.NaN), 0), way.note)}
          </li>
        ))}
      </ul>
    </>
  );
}
