// What is under the pointer, beside it.
import { words } from "../words";
import { decimal, duration } from "../words/format";
import { drawing, reading } from "./drawing";
import { layer } from "./state";
import { valueText } from "./Legend";

const say = words.view;
const BESIDE_PX = 16;
const WIDE_PX = 210;

export function Reading() {
  const at = reading.value;
  const view = drawing.value;
  const found = at && view ? view.under(at.x, at.y) : null;
  if (!at || !view || !found) return null;
  const isRight = at.x > view.stage.canvas.clientWidth - WIDE_PX - BESIDE_PX;
  const isLow = at.y > view.stage.canvas.clientHeight / 2;
  const style = {
    left: `${at.x + (isRight ? -WIDE_PX - BESIDE_PX : BESIDE_PX)}px`,
    top: isLow ? "auto" : `${at.y + BESIDE_PX}px`,
    bottom: isLow ? `${view.stage.canvas.clientHeight - at.y + BESIDE_PX}px` : "auto",
  };
  if ("deviation" in found) {
    return (
      <div class="reading" style={style}>
        <b>{valueText("deviation", found.deviation)}</b>
        <span>{found.deviation > 0 ? say.excess : say.missing}</span>
      </div>
    );
  }
  const { holding } = found;
  return (
    <div class="reading" style={style}>
      <b>{words.operation(holding.process)}</b>
      <span>
        {say.layer} {layer.value + 1}, {say.pass(holding.pass + 1)}
      </span>
      <span>
        {decimal(holding.speed, 1)} mm/s · {decimal(holding.power, 0)} W · {decimal(holding.powder, 1)} g/min
      </span>
      <span>
        {say.quantities.tilt} {decimal(holding.tilt, 1)}°{holding.time !== null && ` · ${duration(holding.time)}`}
      </span>
    </div>
  );
}
