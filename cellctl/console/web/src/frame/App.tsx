// The page: the bar, the alarms, the rail of pages, and the opened page beside the plan and its trends, or alone.
import { useErrorBoundary } from "preact/hooks";
import { AlarmBanner } from "../bar/AlarmBanner";
import { Bar } from "../bar/Bar";
import { Cells } from "../cells/Cells";
import { Alarms } from "../alarms/Alarms";
import { Hand } from "../hand/Hand";
import { Jobs } from "../jobs/Jobs";
import { Machine } from "../machine/Machine";
import { Trends } from "../machine/Trends";
import { Parts } from "../parts/Parts";
import { dialog } from "../state/dialog";
import { isWide, page, type PageName } from "../state/pages";
import { session } from "../state/session";
import { View3d } from "../view3d/View3d";
import { words } from "../words";
import { DialogBox } from "./DialogBox";
import { Footer } from "./Footer";
import { NoticeBox } from "./Notice";
import { Rail } from "./Rail";
import { SignIn } from "./SignIn";
import { TrendPage } from "../trends/TrendPage";

const BODIES: Record<PageName, () => preact.JSX.Element | null> = { machine: Machine, hand: Hand, jobs: Jobs, parts: Parts, alarms: Alarms, log: TrendPage, cells: Cells };

export function App() {
  if (session.value === undefined) return <main class="sign-in" />;
  if (session.value === null) return <SignIn />;
  return (
    <div class="frame">
      <a class="skip" href="#page">
        {words.frame.skip}
      </a>
      <Bar />
      <AlarmBanner />
      <div class="body" inert={dialog.value !== null}>
        <Rail />
        <Content />
        <Footer />
      </div>
      <NoticeBox />
      <DialogBox />
    </div>
  );
}

/** The view stays in the page where it is not shown: it keeps what it has loaded. */
function Content() {
  return (
    <main class={isWide.value ? "content wide" : "content"}>
      <div class="left" hidden={isWide.value}>
        <View3d />
        <Trends />
      </div>
      <div class="page" id="page" role="tabpanel" aria-labelledby={`tab-${page.value}`} tabIndex={0}>
        <PageBody key={page.value} />
      </div>
    </main>
  );
}

/** A page that fails says so and leaves the bar, the rail and the other pages as they are. */
function PageBody() {
  const [error, tryAgain] = useErrorBoundary((found) => console.error(found));
  const Body = BODIES[page.value];
  if (!error) return <Body />;
  return (
    <p class="problem" role="alert">
      <b>{words.frame.pageFailed}</b> {String(error)}{" "}
      <button type="button" class="control" onClick={tryAgain}>
        {words.frame.again}
      </button>
    </p>
  );
}
