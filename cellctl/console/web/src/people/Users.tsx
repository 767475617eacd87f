// Users, for admins: make, change the role, set a password, disable.
import { useEffect, useState } from "preact/hooks";
import type { Role } from "../api/types";
import { words } from "../words";
import { useAsking } from "./Outcome";
import { changeUser, makeUser, readUsers, ROLES, setPassword, type User } from "./state";

const say = words.people.users;

export function roleName(role: string): string {
  return words.frame.roles[role] ?? role;
}

export function RoleOptions() {
  return (
    <>
      {ROLES.map((role) => (
        <option key={role} value={role}>
          {roleName(role)}
        </option>
      ))}
    </>
  );
}

export function Users() {
  const [users, setUsers] = useState<User[] | null>(null);
  const [renewing, setRenewing] = useState("");
  const { busy, ask, shown } = useAsking();
  const read = async () => setUsers(await readUsers());
  useEffect(() => ask(async () => (await read(), "")), []);
  const change = (name: string, what: { role?: Role; disabled?: boolean }) =>
    ask(async () => {
      try {
        await changeUser(name, what);
      } finally {
        await read();
      }
      return "";
    });
  const create = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const given = new FormData(form);
    ask(async () => {
      const made = await makeUser(String(given.get("name")), String(given.get("role")) as Role, String(given.get("password")));
      form.reset();
      await read();
      return say.made(made.name);
    });
  };
  const renew = (event: SubmitEvent) => {
    event.preventDefault();
    const password = String(new FormData(event.currentTarget as HTMLFormElement).get("password"));
    ask(async () => {
      await setPassword(renewing, password);
      setRenewing("");
      await read();
      return say.set(renewing);
    });
  };
  return (
    <>
      {shown}
      {users?.length === 0 && <p class="muted">{say.none}</p>}
      {users && users.length > 0 && (
        <table>
          <thead>
            <tr>
              <th>{say.name}</th>
              <th>{say.role}</th>
              <th>{say.passwordAt}</th>
              <th>{say.state}</th>
              <th />
            </tr>
          </thead>
          <tbody>
            {users.map((user) => (
              <Row key={user.name} user={user} busy={busy} change={change} renew={() => setRenewing(user.name)} />
            ))}
          </tbody>
        </table>
      )}
      {renewing && (
        <form onSubmit={renew} key={renewing}>
          <div class="row">
            <label>
              {say.passwordOf(renewing)}
              <input type="password" name="password" autocomplete="new-password" required minLength={10} maxLength={200} autofocus />
            </label>
            <button type="submit" class="control primary" disabled={busy}>
              {say.setPassword}
            </button>
          </div>
        </form>
      )}
      <form onSubmit={create}>
        <h2>{say.add}</h2>
        <div class="row">
          <label>
            {say.name}
            <input name="name" autocomplete="off" autocapitalize="none" spellcheck={false} required maxLength={64} />
          </label>
          <label>
            {say.role}
            <select name="role">
              <RoleOptions />
            </select>
          </label>
          <label>
            {say.password}
            <input type="password" name="password" autocomplete="new-password" required minLength={10} maxLength={200} />
          </label>
          <button type="submit" class="control primary" disabled={busy}>
            {say.create}
          </button>
        </div>
      </form>
    </>
  );
}

interface RowProps {
  user: User;
  busy: boolean;
  change: (name: string, what: { role?: Role; disabled?: boolean }) => void;
  renew: () => void;
}

function Row({ user, busy, change, renew }: RowProps) {
  const isDisabled = user.disabled_at !== null;
  return (
    <tr>
      <th scope="row">{user.name}</th>
      <td>
        <select
          aria-label={say.roleOf(user.name)}
          value={user.role}
          disabled={busy}
          onChange={(event) => change(user.name, { role: event.currentTarget.value as Role })}
        >
          <RoleOptions />
        </select>
      </td>
      <td class="narrow">{new Date(user.password_at * 1000).toLocaleDateString()}</td>
      <td>{isDisabled ? say.no : say.yes}</td>
      <td class="narrow">
        <button
          type="button"
          class="small"
          disabled={busy}
          aria-label={isDisabled ? say.enableOf(user.name) : say.disableOf(user.name)}
          onClick={() => change(user.name, { disabled: !isDisabled })}
        >
          {isDisabled ? say.enable : say.disable}
        </button>
        <button type="button" class="small" disabled={busy} aria-label={say.passwordOf(user.name)} onClick={renew}>
          {say.setPassword}
        </button>
      </td>
    </tr>
  );
}
