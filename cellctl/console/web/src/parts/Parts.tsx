// The page "parts": the list, one part, one plan, or two plans compared.
import { Compare } from "./Compare";
import { PartList } from "./PartList";
import { PartPage } from "./PartPage";
import { PlanReport } from "./PlanReport";
import { route } from "./route";

export function Parts() {
  const shown = route.value;
  if (shown.view === "part") return <PartPage id={shown.part} like={shown.like} key={shown.part} />;
  if (shown.view === "plan") return <PlanReport id={shown.job} key={shown.job} />;
  if (shown.view === "compare") return <Compare ids={shown.jobs} key={shown.jobs.join()} />;
  return <PartList />;
}
