// Who is signed in at this page.
import { computed, signal } from "@preact/signals";
import { get, post, remove, RequestError, send, useCsrf } from "../api/http";
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
export const isAdmin = computed(() => has("admin"));

/** A user's name and password, or a token. */
export type Credentials = { user: string; password: string } | { token: string };

function take(found: Session): void {
  useCsrf(found.csrf, restore);
  session.value = found;
}

/** Ask the service who is signed in. Raises RequestError if it does not answer. */
export async function restore(): Promise<void> {
  try {
    take(await get<Session>("/session"));
  } catch (error) {
    if (!(error instanceof RequestError) || error.status !== 401) throw error;
    hasEnded.value = session.value != null;
    session.value = null;
  }
}

/** Raises RequestError. */
export async function signIn(given: Credentials): Promise<void> {
  take(await post<Session>("/session", given));
  hasEnded.value = false;
}

/** Change the own password; other sessions of this user end. Raises RequestError. */
export async function changePassword(password: string, newPassword: string): Promise<void> {
  await send("POST", "/session/password", { password, new_password: newPassword });
}

/** everywhere: at other browsers too. Raises RequestError. */
export async function signOut(everywhere = false): Promise<void> {
  await remove(everywhere ? "/session?everywhere=true" : "/session");
  hasEnded.value = false;
  session.value = null;
}
