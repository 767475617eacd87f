// The own account: password, and signing out everywhere.
import { closeDialog } from "../state/dialog";
import { changePassword, session, signOut } from "../state/session";
import { words } from "../words";
import { useAsking } from "./Outcome";

const say = words.people.account;

export function Account() {
  const { busy, ask, shown } = useAsking();
  const person = session.value;
  if (!person) return null;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const [old, fresh, again] = ["old", "fresh", "again"].map((name) => String(new FormData(form).get(name)));
    ask(async () => {
      if (fresh !== again) throw new Error(say.differ);
      await changePassword(old ?? "", fresh ?? "");
      form.reset();
      return say.changed;
    });
  };
  const leave = () =>
    ask(async () => {
      await signOut(true);
      closeDialog();
      return "";
    });
  return (
    <>
      <p>{say.signedIn(person.name, words.frame.roles[person.role] ?? person.role)}</p>
      {!person.is_user && <p class="muted">{say.byToken}</p>}
      {person.is_user && (
        <form onSubmit={submit}>
          <h2>{say.change}</h2>
          <div class="row">
            <label>
              {say.old}
              <input type="password" name="old" autocomplete="current-password" required maxLength={200} />
            </label>
            <label>
              {say.fresh}
              <input type="password" name="fresh" autocomplete="new-password" required minLength={10} maxLength={200} />
            </label>
            <label>
              {say.again}
              <input type="password" name="again" autocomplete="new-password" required minLength={10} maxLength={200} />
            </label>
          </div>
          <p class="muted">{say.rule}</p>
          <div>
            <button type="submit" class="control primary" disabled={busy}>
              {say.submit}
            </button>
          </div>
        </form>
      )}
      {shown}
      <div class="row">
        <button type="button" class="control" disabled={busy} onClick={leave}>
          {say.everywhere}
        </button>
        <p class="muted">{say.everywhereHint}</p>
      </div>
    </>
  );
}
