// Who is signed in, how the page looks, and the keys that work.
import { snapshot } from "../state/cell";
import { closeDialog, openDialog } from "../state/dialog";
import { told } from "../state/notices";
import { session, signOut } from "../state/session";
import { changeTheme, theme } from "../state/theme";
import { words } from "../words";
import { openPeople } from "../people/People";
import { hasLetterKeys, shortcuts } from "./shortcuts";

const say = words.frame;

export function openMenu(): void {
  openDialog(say.menu, Menu);
}

function leave(): void {
  closeDialog();
  void signOut().catch(told);
}

function Menu() {
  const person = session.value;
  const now = snapshot.value;
  return (
    <div class="menu">
      <h2>{say.menu}</h2>
      <p>
        {person && (
          <b>
            {person.name} · {say.roles[person.role] ?? person.role}
          </b>
        )}
        <span class="muted">
          {" "}
          {now?.cell} {now?.cnc.firmware}
        </span>
      </p>
      <div class="row">
        <button type="button" class="control" onClick={leave}>
          {say.signOut}
        </button>
        <button type="button" class="control" onClick={openPeople}>
          {words.people.open}
        </button>
        <button type="button" class="control" aria-label={say.themeAria} onClick={changeTheme}>
          {theme.value === "dark" ? say.light : say.dark}
        </button>
        <button type="button" class="control" autofocus onClick={closeDialog}>
          {say.close}
        </button>
      </div>
      <h3>{say.keys}</h3>
      <dl class="key-list">
        {shortcuts.value.map(({ key, name }) => (
          <div key={key}>
            <dt>
              <kbd>{key}</kbd>
            </dt>
            <dd>{name}</dd>
          </div>
        ))}
      </dl>
      <label class="check">
        <input type="checkbox" checked={hasLetterKeys.value} onChange={(event) => (hasLetterKeys.value = event.currentTarget.checked)} />
        {say.letterKeys}
      </label>
    </div>
  );
}
