// What the page "parts" shows, kept in the address after #, so that a link can be sent.
import { effect, signal } from "@preact/signals";
import { open, page } from "../state/pages";

export type Route =
  | { view: "list" }
  | { view: "part"; part: string; like: string | null } // like: the job whose recipe to begin with
  | { view: "plan"; job: string }
  | { view: "compare"; jobs: [string, string] };

const ID = /^[\w-]{1,60}$/;

function parsed(hash: string): Route | null {
  const [page, view, a, b] = hash.replace(/^#/, "").split("/").map(decodeURIComponent);
  if (page !== "parts") return null;
  if (view === "part" && a && ID.test(a)) return { view, part: a, like: b && ID.test(b) ? b : null };
  if (view === "plan" && a && ID.test(a)) return { view, job: a };
  if (view === "compare" && a && b && ID.test(a) && ID.test(b)) return { view, jobs: [a, b] };
  return { view: "list" };
}

/** The address of a route. */
export function addressOf(route: Route): string {
  if (route.view === "part") return `#parts/part/${route.part}${route.like ? `/${route.like}` : ""}`;
  if (route.view === "plan") return `#parts/plan/${route.job}`;
  if (route.view === "compare") return `#parts/compare/${route.jobs.join("/")}`;
  return "#parts";
}

function read(): Route | null {
  try {
    return parsed(location.hash);
  } catch {
    return null; // an address that was cut off within a letter
  }
}

export const route = signal<Route>(read() ?? { view: "list" });

/** Show something of this page, wherever one is. */
export function go(next: Route): void {
  if (addressOf(next) !== location.hash) history.pushState(null, "", addressOf(next));
  route.value = next;
  open("parts");
  document.getElementById("page")?.scrollTo(0, 0);
}

function follow(): void {
  const next = read();
  if (!next) return;
  route.value = next;
  open("parts");
}

addEventListener("hashchange", follow);
addEventListener("popstate", follow);
follow();
effect(() => {
  if (page.value !== "parts" && read()) history.replaceState(null, "", location.pathname);
  else if (page.value === "parts" && !read()) history.replaceState(null, "", addressOf(route.peek()));
});
