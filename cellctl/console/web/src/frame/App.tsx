// The page: the bar, the plan with its trends on the left, one of three pages on the right.
import { signal } from "@preact/signals";
import { AlarmBanner } from "../bar/AlarmBanner";
import { Bar } from "../bar/Bar";
import { Control } from "../bar/Control";
import { Alarms } from "../alarms/Alarms";
import { Hand } from "../hand/Hand";
import { Jobs } from "../jobs/Jobs";
import { EventLog } from "../log/EventLog";
import { Machine } from "../machine/Machine";
import { Trends } from "../machine/Trends";
import { Parts } from "../parts/Parts";
import { waiting } from "../state/jobs";
import { session } from "../state/session";
import { View3d } from "../view3d/View3d";
import { words } from "../words";
import { Footer } from "./Footer";
import { NoticeBox } from "./Notice";
import { SignIn } from "./SignIn";

const TABS = ["machine", "hand", "jobs", "parts", "alarms", "log"] as const;
const tab = signal<(typeof TABS)[number]>("machine");

export function App() {
  if (session.value === undefined) return <main class="sign-in" />;
  if (session.value === null) return <SignIn />;
  return (
    <div class="frame">
      <Bar />
      <Control />
      <AlarmBanner />
      <main class="content">
        <div class="left">
          <View3d />
          <Trends />
        </div>
        <div class="right">
          <Tabs />
          <div class="page" id="page" role="tabpanel" aria-labelledby={`tab-${tab.value}`} tabIndex={-1}>
            {tab.value === "machine" && <Machine />}
            {tab.value === "hand" && <Hand />}
            {tab.value === "jobs" && <Jobs />}
            {tab.value === "parts" && <Parts />}
            {tab.value === "alarms" && <Alarms />}
            {tab.value === "log" && <EventLog />}
          </div>
        </div>
      </main>
      <Footer />
      <NoticeBox />
    </div>
  );
}

function Tabs() {
  const move = (event: KeyboardEvent) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    const next = TABS[(TABS.indexOf(tab.value) + step + TABS.length) % TABS.length];
    if (!next) return;
    tab.value = next;
    document.getElementById(`tab-${next}`)?.focus();
  };
  const { table, approval } = waiting.value;
  return (
    <div class="tabs" role="tablist" aria-label={words.frame.tabsAria} onKeyDown={move}>
      {TABS.map((name) => (
        <button
          type="button"
          role="tab"
          key={name}
          id={`tab-${name}`}
          aria-controls="page"
          aria-selected={tab.value === name}
          tabIndex={tab.value === name ? 0 : -1}
          onClick={() => (tab.value = name)}
        >
          {words.frame.tabs[name]}
          {name === "jobs" && (table || approval) && <i class="dot" aria-hidden="true" />}
        </button>
      ))}
    </div>
  );
}
