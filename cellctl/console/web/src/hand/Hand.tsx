// The page "by hand": moving the machine, overrides of the running job.
import { Flow } from "./Flow";
import { Jog } from "./Jog";
import { Overrides } from "./Overrides";

export function Hand() {
  return (
    <section class="hand">
      <div class="hand-columns">
        <Jog />
        <div class="hand-side">
          <Overrides />
          <Flow />
        </div>
      </div>
    </section>
  );
}
