// The page "by hand": moving the machine, overrides, powder and gas; touch-off; tools.
import { signal } from "@preact/signals";
import { words } from "../words";
import { Flow } from "./Flow";
import { Jog } from "./Jog";
import { Overrides } from "./Overrides";
import { Tools } from "./Tools";
import { TouchOff } from "./TouchOff";

const SIDES = ["machine", "touchOff", "tools"] as const;
const side = signal<(typeof SIDES)[number]>("machine");

export function Hand() {
  return (
    <section class="hand">
      <div class="hand-columns">
        <Jog />
        <div class="hand-side">
          <div class="choice sides" role="group" aria-label={words.hand.sides}>
            {SIDES.map((one) => (
              <button type="button" key={one} class="control" aria-pressed={side.value === one} onClick={() => (side.value = one)}>
                {words.hand.side[one]}
              </button>
            ))}
          </div>
          {side.value === "machine" && (
            <>
              <Overrides />
              <Flow />
            </>
          )}
          {side.value === "touchOff" && <TouchOff />}
          {side.value === "tools" && <Tools />}
        </div>
      </div>
    </section>
  );
}
