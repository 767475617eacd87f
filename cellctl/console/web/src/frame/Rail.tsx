// The pages, as a rail beside the page or, on a phone, as a bar below it.
import { snapshot } from "../state/cell";
import { alarmsElsewhere } from "../state/fleet";
import { waiting } from "../state/jobs";
import { open, page, pages, type PageName } from "../state/pages";
import { words } from "../words";

const ICONS: Record<PageName, string> = {
  machine: "M4 20h16M6 20V8h5v12M11 12h7v8M8 4v4M14.5 12V7M14.5 16v.1",
  hand: "M12 3v18M3 12h18M12 3l-3 3M12 3l3 3M12 21l-3-3M12 21l3-3M3 12l3-3M3 12l3 3M21 12l-3-3M21 12l-3 3",
  jobs: "M5 4h14v16H5zM8.5 9h7M8.5 13h7M8.5 17h4",
  parts: "M12 3l8 4.5v9L12 21l-8-4.5v-9zM4 7.5l8 4.5 8-4.5M12 12v9",
  alarms: "M12 4l9 16H3zM12 10v5M12 17.5v.1",
  cells: "M4 4h7v7H4zM13 4h7v7h-7zM4 13h7v7H4zM13 13h7v7h-7z",
  log: "M4 6h.1M4 12h.1M4 18h.1M8 6h12M8 12h12M8 18h12",
};
const STEPS: Record<string, number> = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 };

function move(event: KeyboardEvent): void {
  const step = STEPS[event.key];
  if (!step) return;
  const at = pages.value.findIndex(({ name }) => name === page.value);
  const next = pages.value[(at + step + pages.value.length) % pages.value.length];
  if (!next) return;
  event.preventDefault();
  open(next.name);
  document.getElementById(`tab-${next.name}`)?.focus();
}

/** How many things on a page wait for a person. */
function calls(name: PageName): number {
  if (name === "cells") return alarmsElsewhere.value;
  if (name === "alarms") return snapshot.value?.alarms.length ?? 0;
  const { table, approval } = waiting.value;
  return name === "jobs" ? Number(Boolean(table)) + Number(Boolean(approval)) : 0;
}

export function Rail() {
  return (
    <div class="rail" role="tablist" aria-orientation="vertical" aria-label={words.frame.tabsAria} onKeyDown={move}>
      {pages.value.map(({ name }) => (
        <button
          type="button"
          role="tab"
          key={name}
          id={`tab-${name}`}
          aria-controls="page"
          aria-selected={page.value === name}
          tabIndex={page.value === name ? 0 : -1}
          onClick={() => open(name)}
        >
          <svg class="sign" viewBox="0 0 24 24" aria-hidden="true" focusable="false">
            <path d={ICONS[name]} />
          </svg>
          <span>{words.frame.tabs[name]}</span>
          {calls(name) > 0 && <i class={`count count-${name === "cells" ? "alarms" : name}`}>{calls(name)}</i>}
        </button>
      ))}
    </div>
  );
}
