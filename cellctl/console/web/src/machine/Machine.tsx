// Everything that the machine says about itself, on one page.
import { isStale } from "../state/cell";
import { Axes } from "./Axes";
import { Conditions } from "./Conditions";
import { Cnc, LineCounts } from "./Cnc";
import { Process } from "./Process";

export function Machine() {
  return (
    <div class={`machine ${isStale.value ? "is-stale" : ""}`}>
      <Conditions />
      <div class="columns">
        <Axes />
        <Cnc />
      </div>
      <LineCounts />
      <Process />
    </div>
  );
}
