// Who is signed in at this page.
import { computed, signal } from "@preact/signals";
import { get, post, remove, RequestError } from "../api/http";
import type { Role, Session } from "../api/types";

const RANK: Record<Role, number> = { viewer: 0, operator: 1, engineer: 2, admin: 3 };

/** undefined: not known yet; null: nobody. */
export const session = signal<Session | null | undefined>(undefined);
/** Whether the last session ended without being asked to. */
export const hasEnded = signal(false);

function has(role: Role): boolean {
  return session.value != null && RANK[session.value.role] >= RANK[role];
}

export const isOperator = computed(() => has("operator"));
export const isEngineer = computed(() => has("engineer"));

/** Ask the service who is signed in. Raises RequestError if it does not answer. */
export async function restore(): Promise<void> {
  try {
    session.value = await get<Session>("/session");
  } catch (error) {
    if (!(error instanceof RequestError) || error.status !== 401) throw error;
    hasEnded.value = session.value != null;
    session.value = null;
  }
}

/** Raises RequestError. */
export async function signIn(token: string): Promise<void> {
  session.value = await post<Session>("/session", { token });
  hasEnded.value = false;
}

/** Raises RequestError. */
export async function signOut(): Promise<void> {
  await remove("/session");
  hasEnded.value = false;
  session.value = null;
}
