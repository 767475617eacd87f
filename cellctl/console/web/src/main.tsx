// Starts the page: the session first, then the live feed for as long as somebody is signed in.
import { effect } from "@preact/signals";
import { render } from "preact";
import "uplot/dist/uPlot.min.css";
import { Live } from "./api/live";
import { RequestError } from "./api/http";
import { App } from "./frame/App";
import { openMenu } from "./frame/Menu";
import { listenForKeys } from "./frame/shortcuts";
import { isConnected, lastSeq, take, takeEvents } from "./state/cell";
import { keepPresent } from "./state/control";
import { readJobs, takeJob } from "./state/jobs";
import { followFleet } from "./state/fleet";
import { followPlan } from "./state/plan";
import { restore, session } from "./state/session";
import { record } from "./state/trends";
import "./styles/base.css";
import "./styles/bar.css";
import "./styles/layout.css";
import "./styles/machine.css";
import "./styles/jobs.css";
import "./styles/view.css";
import "./styles/hand.css";
import "./styles/parts.css";
import "./styles/alarms.css";
import "./styles/trends.css";
import "./styles/people.css";
import "./styles/cells.css";

const RETRY_MS = 2000;

function connect(): Live {
  return new Live({
    snapshot: (snapshot) => {
      take(snapshot);
      record(snapshot);
    },
    events: takeEvents,
    job: takeJob,
    connected: (is) => (isConnected.value = is),
    opening: async () => {
      await restore();
      if (session.value) await readJobs();
    },
    lastSeq,
  });
}

async function begin(): Promise<void> {
  try {
    await restore();
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    setTimeout(() => void begin(), RETRY_MS);
  }
}

let live: Live | null = null;
effect(() => {
  if (session.value && !live) live = connect();
  if (!session.value && live) {
    live.close();
    live = null;
  }
});
followPlan();
followFleet();
keepPresent();
listenForKeys(openMenu);
void begin();

const root = document.getElementById("app");
if (root) render(<App />, root);
