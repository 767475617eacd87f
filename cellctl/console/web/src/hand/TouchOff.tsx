// Touch-off: bring the tip to a place, press "here", look at what the points say, adopt it with a reason.
import { useEffect, useRef, useState } from "preact/hooks";
import { newKey, post } from "../api/http";
import { isStale, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { told } from "../state/notices";
import { facts } from "../state/plan";
import { words } from "../words";
import { clock, fixed } from "../words/format";
import { Picture, type Kind } from "./Pictures";
import { keep, kept, type Point } from "./touched";

const say = words.hand;
const LEAST: Record<Kind, number> = { pivot: 3, plane: 3, origin: 1, tool: 1 }; // points without which nothing is to be fitted
const KINDS: readonly Kind[] = ["pivot", "plane", "origin", "tool"];

interface Result {
  name: string;
  value_mm: number[];
  before_mm: number[];
  shift_mm: number[];
  residuals_mm: number[];
  residual_mm: number;
  tilt_deg: number;
  adoptable: boolean;
  why: string;
}

export function TouchOff() {
  const cell = snapshot.value?.cell;
  return cell ? <Wizard key={cell} cell={cell} /> : <p class="muted">{words.noData}</p>; // the points belong to its axes
}

function Wizard({ cell }: { cell: string }) {
  const [before] = useState(() => kept(cell, Date.now() / 1000));
  const [isOld, setOld] = useState(before !== null);
  const [kind, setKind] = useState<Kind>(before?.kind ?? "pivot");
  const [axis, setAxis] = useState(before?.axis ?? "C");
  const [tool, setTool] = useState(before?.tool ?? (snapshot.peek()?.cnc.tool || 1));
  const [block, setBlock] = useState(before?.block ?? 0);
  const [points, show] = useState<Point[]>(before?.points ?? []);
  const isUnhomed = snapshot.value?.state === "UNHOMED";
  const setPoints = (next: Point[]) => {
    show(next);
    if (next.length === 0) setOld(false);
    keep({ cell, at: Date.now() / 1000, kind, axis, tool, block, points: next });
  };
  useEffect(() => {
    if (isUnhomed) setPoints([]); // where the axes' zero is is not known any more
  }, [isUnhomed]);
  const [result, setResult] = useState<Result | null>(null);
  const [problem, setProblem] = useState("");
  const rotary = facts.value?.axes.filter((one) => one.kind === "rotary") ?? [];
  const asked = { kind, axis: kind === "pivot" ? axis : null, tool: kind === "tool" ? tool : null, block_mm: kind === "tool" ? block : 0, points };
  useEffect(() => {
    setResult(null);
    setProblem("");
    if (points.length < LEAST[kind]) return;
    let isPast = false;
    post<Result>("/cell/touch_off/fit", asked).then(
      (found) => !isPast && setResult(found),
      (error: Error) => !isPast && setProblem(error.message),
    );
    return () => {
      isPast = true;
    };
  }, [points, kind, axis, tool, block]);
  const begin = (next: Kind) => {
    setKind(next);
    setPoints([]);
  };
  const touch = () => post<Point>("/cell/touch_off/point", { tool }).then((point) => setPoints([...points, point]), told);
  const off = !mayCommand.value || isStale.value || snapshot.value?.state !== "IDLE";
  return (
    <section class="panel touch-off">
      <div class="choice" role="group" aria-label={say.touchOff}>
        {KINDS.map((one) => (
          <button type="button" key={one} class="control" aria-pressed={one === kind} onClick={() => begin(one)}>
            {say.kinds[one]}
          </button>
        ))}
      </div>
      <div class="guide-row">
        <Picture kind={kind} />
        <ol class="guide-steps">
          {say.steps[kind].map((line) => (
            <li key={line}>{line}</li>
          ))}
        </ol>
      </div>
      <div class="row">
        {kind === "pivot" && <Select label={say.axis} value={axis} all={rotary.map((one) => [one.letter, one.letter] as const)} choose={setAxis} />}
        <Select label={say.touches} value={String(tool)} all={(facts.value?.tools ?? []).map((one) => [String(one.number), `T${one.number} ${one.name}`] as const)} choose={(one) => setTool(Number(one))} />
        {kind === "tool" && (
          <label>
            {say.block}
            <input type="number" min="0" max="500" step="0.001" value={block} onInput={(event) => setBlock(Number(event.currentTarget.value) || 0)} />
          </label>
        )}
        <button type="button" class="control primary here" title={whyNot.value} disabled={off} onClick={() => void touch()}>
          {say.here}
        </button>
      </div>
      {isOld && before && (
        <p class="row kept" role="status">
          <span class="grow">{say.kept(clock(before.at))}</span>
          <button type="button" class="control" onClick={() => setPoints([])}>
            {say.beginAgain}
          </button>
        </p>
      )}
      <Points points={points} result={result} remove={(at) => setPoints(points.filter((_, other) => other !== at))} />
      {points.length > 0 && points.length < LEAST[kind] && <p class="muted">{say.more(LEAST[kind] - points.length)}</p>}
      {problem && points.length > 0 && <p class="muted">{problem}</p>}
      {result && <Outcome result={result} asked={asked} done={() => setPoints([])} />}
    </section>
  );
}

interface SelectProps {
  label: string;
  value: string;
  all: (readonly [string, string])[];
  choose: (one: string) => void;
}

function Select({ label, value, all, choose }: SelectProps) {
  return (
    <label>
      {label}
      <select value={value} onChange={(event) => choose(event.currentTarget.value)}>
        {all.map(([one, text]) => (
          <option key={one} value={one}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}

function Points({ points, result, remove }: { points: Point[]; result: Result | null; remove: (at: number) => void }) {
  const letters = facts.value?.axes.map((one) => one.letter) ?? [];
  if (points.length === 0) return <p class="muted">{say.noPoints}</p>;
  return (
    <table class="points">
      <thead>
        <tr>
          <th scope="col">{say.point}</th>
          {letters.map((letter) => (
            <th scope="col" key={letter}>
              {letter}
            </th>
          ))}
          <th scope="col">{say.residual}</th>
          <th />
        </tr>
      </thead>
      <tbody>
        {points.map((point, at) => (
          <tr key={at}>
            <th scope="row">{at + 1}</th>
            {letters.map((letter) => (
              <td key={letter}>{fixed(point.joints[letter], 3)}</td>
            ))}
            <td class="strong">{result?.residuals_mm[at] === undefined ? words.dash : fixed(result.residuals_mm[at], 3)}</td>
            <td>
              <button type="button" class="small" aria-label={say.removePoint(at + 1)} onClick={() => remove(at)}>
                ✕
              </button>
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Outcome({ result, asked, done }: { result: Result; asked: object; done: () => void }) {
  const reason = useRef<HTMLInputElement>(null);
  const three = (values: number[]) => values.map((value) => fixed(value, 3)).join("  ");
  const adopt = (event: Event) => {
    event.preventDefault();
    post("/cell/touch_off/adopt", { ...asked, id: newKey("adopt"), because: reason.current?.value.trim() ?? "" }).then(done, told);
  };
  return (
    <form class="outcome" onSubmit={adopt}>
      <dl class="pairs">
        <dt>{say.stands}</dt>
        <dd>{three(result.before_mm)} mm</dd>
        <dt>{say.measured}</dt>
        <dd>{three(result.value_mm)} mm</dd>
        <dt>{say.difference}</dt>
        <dd class="shift">{three(result.shift_mm)} mm</dd>
        <dt>{say.leftOver}</dt>
        <dd>
          {fixed(result.residual_mm, 3)} mm{result.tilt_deg > 0 && `, ${say.tilt} ${fixed(result.tilt_deg, 3)}°`}
        </dd>
      </dl>
      {!result.adoptable && <p class="problem">{result.why}</p>}
      <p class="muted small-print">{say.adoptHint}</p>
      <div class="row">
        <label class="grow">
          {say.because}
          <input ref={reason} required maxLength={500} />
        </label>
        <button type="submit" class="control primary" disabled={!result.adoptable || !mayCommand.value}>
          {say.adopt}
        </button>
      </div>
    </form>
  );
}
