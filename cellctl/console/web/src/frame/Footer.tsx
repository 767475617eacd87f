// Which cell, which connection, who is signed in, and the choices of this browser.
import { isConnected, snapshot } from "../state/cell";
import { told } from "../state/notices";
import { session, signOut } from "../state/session";
import { changeTheme, theme } from "../state/theme";
import { changeLanguage, words } from "../words";
import { language, LANGUAGE_NAMES, LANGUAGES } from "../words/language";

const say = words.frame;
const OTHER = LANGUAGES.find((one) => one !== language) ?? language;

export function Footer() {
  const now = snapshot.value;
  const person = session.value;
  return (
    <footer class="footer">
      <span class={isConnected.value ? "feed up" : "feed down"}>
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
      <button type="button" class="small" aria-label={`${LANGUAGE_NAMES[OTHER]}: ${say.languageAria}`} onClick={() => void changeLanguage(OTHER).catch(told)}>
        {LANGUAGE_NAMES[OTHER]}
      </button>
      <button type="button" class="small" aria-label={say.themeAria} onClick={changeTheme}>
        {theme.value === "dark" ? say.light : say.dark}
      </button>
      <button type="button" class="small" onClick={() => void signOut().catch(told)}>
        {say.signOut}
      </button>
    </footer>
  );
}
