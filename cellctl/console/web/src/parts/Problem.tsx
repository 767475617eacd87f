// A refusal in its own words.
import type { Notice } from "../state/notices";

export function Problem({ of }: { of: Notice | null }) {
  if (!of) return null;
  return (
    <p class="problem" role="alert">
      <b>{of.title}</b> {of.detail} {of.hint}
    </p>
  );
}
