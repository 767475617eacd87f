// The part in 3-D.
import { effect } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Part } from "../api/types";
import { told } from "../state/notices";
import { theme } from "../state/theme";
import { words } from "../words";
import { PartView } from "./part_view";

const say = words.view;

export function PartStage({ part, place }: { part: Part; place: number[] | null }) {
  const host = useRef<HTMLDivElement>(null);
  const view = useRef<PartView | null>(null);
  const [hasGl, setGl] = useState(true);
  useEffect(() => {
    if (!host.current) return;
    let made: PartView;
    try {
      made = new PartView(host.current);
    } catch (error) {
      console.warn(error);
      setGl(false);
      return;
    }
    view.current = made;
    let isThere = true;
    made.load(part.id, part.bbox_mm).catch((error) => isThere && told(error));
    const end = effect(() => {
      void theme.value;
      made.paint();
    });
    return () => {
      isThere = false;
      end();
      made.dispose();
      view.current = null;
    };
  }, [part.id]);
  useEffect(() => view.current?.point(place), [place]);
  return (
    <div class="part-view panel">
      <div class="part-stage" ref={host} role="img" aria-label={words.parts.picture(part.name)} />
      {!hasGl && <p class="view-empty">{say.noGl}</p>}
      <div class="part-tools" role="group" aria-label={words.parts.looks}>
        {(["fit", "top", "side"] as const).map((name) => (
          <button type="button" class="small" key={name} onClick={() => view.current?.look(name)}>
            {say[name]}
          </button>
        ))}
      </div>
    </div>
  );
}
