// People, tokens and the trail as the service tells them.
import { get, post, remove, send } from "../api/http";
import type { Page, Role, Scope } from "../api/types";

export const ROLES: Role[] = ["viewer", "operator", "engineer", "admin"];
export const SCOPES: Scope[] = ["read", "jobs", "cell", "admin"];

export interface User {
  name: string;
  role: Role;
  created_at: number;
  password_at: number;
  disabled_at: number | null;
}

export interface Token {
  id: string;
  name: string;
  role: Role;
  scopes: Scope[];
  created_at: number;
  expires_at: number | null;
  revoked_at: number | null;
}

export interface Deed {
  seq: number;
  at: number;
  who: string;
  role: string;
  origin: string;
  verb: string;
  target: string;
  because: string;
  outcome: string;
}

export interface Verdict {
  rows: number;
  head: string;
  fault: string;
}

export interface NewToken {
  name: string;
  role: Role;
  scopes: Scope[];
  lifetime_s: number | null;
}

export const readUsers = async (): Promise<User[]> => (await get<{ items: User[] }>("/users")).items;
export const makeUser = (name: string, role: Role, password: string): Promise<User> => post("/users", { name, role, password });
export const changeUser = (name: string, change: { role?: Role; disabled?: boolean }): Promise<void> =>
  send("PATCH", `/users/${encodeURIComponent(name)}`, change);
export const setPassword = (name: string, password: string): Promise<void> =>
  send("POST", `/users/${encodeURIComponent(name)}/password`, { password });

export const readTokens = async (): Promise<Token[]> => (await get<{ items: Token[] }>("/tokens")).items;
export const makeToken = (asked: NewToken): Promise<Token & { secret: string }> => post("/tokens", asked);
export const revokeToken = (id: string): Promise<void> => remove(`/tokens/${encodeURIComponent(id)}`);

/** A page of the trail, newest first; what is empty is not asked for. */
export function readTrail(asked: Record<string, string>): Promise<Page<Deed>> {
  const query = new URLSearchParams(Object.entries(asked).filter(([, value]) => value));
  return get<Page<Deed>>(`/audit?${query.toString()}`);
}

export const verifyTrail = (): Promise<Verdict> => get<Verdict>("/audit/verdict");
