// What the hand is to do, drawn: one picture for each kind of touch-off.
import { words } from "../words";

const say = words.hand;
export type Kind = "pivot" | "plane" | "origin" | "tool";

export function Picture({ kind }: { kind: Kind }) {
  return (
    <svg class="picture" viewBox="0 0 240 150" role="img" aria-label={say.pictures[kind]}>
      {kind === "pivot" ? <Pivot /> : kind === "plane" ? <Plane /> : kind === "origin" ? <Origin /> : <Length />}
    </svg>
  );
}

function Pivot() {
  const marks = [0, 120, 240].map((deg) => [120 + 62 * Math.cos((deg * Math.PI) / 180), 80 + 40 * Math.sin((deg * Math.PI) / 180)] as const);
  return (
    <>
      <ellipse class="body" cx="120" cy="80" rx="96" ry="62" />
      <ellipse class="guide" cx="120" cy="80" rx="62" ry="40" />
      <path class="centre" d="M110 80h20M120 70v20" />
      {marks.map(([x, y], at) => (
        <g key={at}>
          <circle class={at === 0 ? "mark now" : "mark"} cx={x} cy={y} r="7" />
          <text x={x + 11} y={y + 4}>{at + 1}</text>
        </g>
      ))}
      <path class="probe" d="M182 10v55m-5 -9l5 9l5-9" />
      <path class="turn" d="M60 24a90 56 0 0 1 70-14m-9-6l9 6l-6 9" />
    </>
  );
}

function Plane() {
  return (
    <>
      <path class="body" d="M20 110L95 60H225L160 130Z" />
      {([[62, 104], [110, 72], [188, 76]] as const).map(([x, y], at) => (
        <g key={at}>
          <circle class="mark" cx={x} cy={y} r="5" />
          <text x={x - 16} y={y - 4}>{at + 1}</text>
        </g>
      ))}
      <path class="probe" d="M188 8v62m-5-9l5 9l5-9" />
      <path class="guide" d="M62 104L110 72L188 76Z" />
    </>
  );
}

function Origin() {
  return (
    <>
      <path class="body" d="M20 120L95 70H225L160 140Z" />
      <path class="centre" d="M118 103h44M118 103l-20 14M118 103V62" />
      <text x="164" y="107">X</text>
      <text x="86" y="124">Y</text>
      <text x="104" y="62">Z</text>
      <path class="probe" d="M118 8v46m-5-9l5 9l5-9" />
    </>
  );
}

function Length() {
  return (
    <>
      <path class="body" d="M15 122H225V140H15Z" />
      <rect class="block" x="85" y="92" width="70" height="30" />
      <path class="body" d="M96 12H144V48L128 80H112L96 48Z" />
      <path class="centre" d="M112 84H128" />
      <path class="guide" d="M170 92H205M170 122H205M188 92V122" />
      <text x="195" y="111">h</text>
    </>
  );
}
