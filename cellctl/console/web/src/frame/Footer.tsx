// Which cell, which connection, who has control, and the way to the choices of this browser.
import { Control } from "../bar/Control";
import { isConnected, snapshot } from "../state/cell";
import { told } from "../state/notices";
import { session } from "../state/session";
import { changeLanguage, words } from "../words";
import { language, LANGUAGE_NAMES, LANGUAGES } from "../words/language";
import { openMenu } from "./Menu";

const say = words.frame;
const OTHER = LANGUAGES.find((one) => one !== language) ?? language;

export function Footer() {
  const now = snapshot.value;
  return (
    <footer class="footer">
      <span class={isConnected.value ? "feed up" : "feed down"}>
        <i aria-hidden="true">{isConnected.value ? "●" : "○"}</i> <span>{isConnected.value ? say.connected : say.reconnecting}</span>
      </span>
      <span class="cell-name">{now?.cell}</span>
      {now?.mode === "sim" && <span class="badge">{words.bar.simulated}</span>}
      <Control />
      <button type="button" class="small" lang={OTHER} aria-label={`${LANGUAGE_NAMES[OTHER]}, ${say.languageAria}`} onClick={() => void changeLanguage(OTHER).catch(told)}>
        {LANGUAGE_NAMES[OTHER]}
      </button>
      <button type="button" class="small menu-button" aria-haspopup="dialog" onClick={openMenu}>
        <i aria-hidden="true">≡</i> <span>{session.value?.name ?? say.menu}</span>
        <span class="hidden-word">{say.menu}</span>
      </button>
    </footer>
  );
}
