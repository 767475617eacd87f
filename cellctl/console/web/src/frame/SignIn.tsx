// Signing in with name and password, or with a token.
import { useEffect, useRef, useState } from "preact/hooks";
import { noticeOf, type Notice } from "../state/notices";
import { hasEnded, signIn, type Credentials } from "../state/session";
import { words } from "../words";

const say = words.signIn;

/** What was typed in, null if something is missing. */
function credentials(form: FormData): Credentials | null {
  const [user, password, token] = ["user", "password", "token"].map((name) => String(form.get(name) ?? ""));
  if (token?.trim()) return { token: token.trim() };
  return user?.trim() && password ? { user: user.trim(), password } : null;
}

export function SignIn() {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Notice | null>(null);
  const first = useRef<HTMLInputElement>(null);
  useEffect(() => first.current?.focus(), []);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const given = credentials(new FormData(event.currentTarget as HTMLFormElement));
    if (!given) return setProblem(say.missing);
    setBusy(true);
    try {
      await signIn(given);
    } catch (error) {
      setProblem(noticeOf(error));
      setBusy(false);
    }
  };
  return (
    <main class="sign-in">
      <form class="panel" onSubmit={(event) => void submit(event)}>
        <h1>{words.title}</h1>
        {hasEnded.value && <p role="status">{say.ended}</p>}
        <label>
          {say.name}
          <input ref={first} type="text" name="user" autocomplete="username" autocapitalize="none" spellcheck={false} maxLength={64} />
        </label>
        <label>
          {say.password}
          <input type="password" name="password" autocomplete="current-password" maxLength={200} />
        </label>
        <p class="or">
          <span>{say.or}</span>
        </p>
        <label>
          {say.token}
          <input type="password" name="token" autocomplete="off" maxLength={200} />
        </label>
        <p class="muted">{say.hint}</p>
        {problem && (
          <p class="problem" role="alert">
            <b>{problem.title}</b> {problem.detail}. {problem.hint}
          </p>
        )}
        <button type="submit" class="control primary" disabled={busy}>
          {busy ? say.working : say.submit}
        </button>
        <p class="muted">{say.lead}</p>
      </form>
    </main>
  );
}
