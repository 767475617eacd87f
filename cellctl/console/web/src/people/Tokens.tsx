// Tokens, for admins: make one as narrow as its use, revoke it.
import { useEffect, useState } from "preact/hooks";
import type { Role, Scope } from "../api/types";
import { words } from "../words";
import { useAsking } from "./Outcome";
import { makeToken, readTokens, revokeToken, SCOPES, type Token } from "./state";
import { RoleOptions, roleName } from "./Users";

const say = words.people.tokens;
const DAY_S = 86_400;

export function Tokens() {
  const [tokens, setTokens] = useState<Token[] | null>(null);
  const [secret, setSecret] = useState("");
  const { busy, ask, shown } = useAsking();
  const read = async () => setTokens((await readTokens()).reverse());
  useEffect(() => ask(async () => (await read(), "")), []);
  const create = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const given = new FormData(form);
    const days = Number(given.get("days"));
    ask(async () => {
      const made = await makeToken({
        name: String(given.get("name")),
        role: String(given.get("role")) as Role,
        scopes: given.getAll("scope") as Scope[],
        lifetime_s: days > 0 ? days * DAY_S : null,
      });
      form.reset();
      setSecret(made.secret);
      await read();
      return "";
    });
  };
  const revoke = (id: string) =>
    ask(async () => {
      await revokeToken(id);
      await read();
      return "";
    });
  return (
    <>
      {shown}
      {secret && (
        <p class="done" role="status">
          {say.secret}
          <br />
          <span class="secret">{secret}</span>
        </p>
      )}
      <form onSubmit={create}>
        <h2>{say.add}</h2>
        <div class="row">
          <label>
            {say.name}
            <input name="name" autocomplete="off" required maxLength={100} />
          </label>
          <label>
            {say.role}
            <select name="role">
              <RoleOptions />
            </select>
          </label>
          <label>
            {say.days}
            <input name="days" type="number" min={1} max={3650} inputMode="numeric" />
          </label>
        </div>
        <fieldset class="checks">
          <legend>{say.scopes}</legend>
          {SCOPES.map((scope) => (
            <label class="check" key={scope}>
              <input type="checkbox" name="scope" value={scope} defaultChecked={scope !== "admin"} />
              {say.scope[scope]}
            </label>
          ))}
        </fieldset>
        <div>
          <button type="submit" class="control primary" disabled={busy}>
            {say.create}
          </button>
        </div>
      </form>
      <table>
        <thead>
          <tr>
            <th>{say.name}</th>
            <th>{say.role}</th>
            <th>{say.scopes}</th>
            <th>{say.expires}</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {tokens?.map((token) => (
            <tr key={token.id}>
              <th scope="row">{token.name}</th>
              <td>{roleName(token.role)}</td>
              <td>{token.scopes.filter((scope) => scope !== "admin" || token.role === "admin").map((scope) => say.scope[scope]).join(", ")}</td>
              <td class="narrow">{token.expires_at === null ? say.never : new Date(token.expires_at * 1000).toLocaleDateString()}</td>
              <td class="narrow">
                {token.revoked_at !== null ? (
                  <span class="muted">{say.ended}</span>
                ) : (
                  <button type="button" class="small" disabled={busy} aria-label={say.revokeOf(token.name)} onClick={() => revoke(token.id)}>
                    {say.revoke}
                  </button>
                )}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </>
  );
}
