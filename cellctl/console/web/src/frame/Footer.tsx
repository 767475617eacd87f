// Which cell, which connection, who is signed in.
import { isConnected, snapshot } from "../state/cell";
import { told } from "../state/notices";
import { session, signOut } from "../state/session";
import { changeTheme, theme } from "../state/theme";
import { words } from "../words";

const say = words.frame;

export function Footer() {
  const now = snapshot.value;
  const person = session.value;
  return (
    <footer class="footer">
      <span class={isConnected.value ? "link up" : "link down"}>
        <i aria-hidden="true">{isConnected.value ? "●" : "○"}</i> {isConnected.value ? say.connected : say.reconnecting}
      </span>
      <span>{now?.cell}</span>
      {now?.mode === "sim" && <span class="badge">{words.bar.simulated}</span>}
      <span class="muted">{now?.cnc.firmware}</span>
      <span class="space" />
      {person && (
        <span class="person">
          {person.name} · {say.roles[person.role] ?? person.role}
        </span>
      )}
      <button type="button" class="small" aria-label={say.themeAria} onClick={changeTheme}>
        {theme.value === "dark" ? say.light : say.dark}
      </button>
      <button type="button" class="small" onClick={() => void signOut().catch(told)}>
        {say.signOut}
      </button>
    </footer>
  );
}
