// Signing in with a token.
import { useEffect, useRef, useState } from "preact/hooks";
import { noticeOf, type Notice } from "../state/notices";
import { hasEnded, signIn } from "../state/session";
import { words } from "../words";

const say = words.signIn;

export function SignIn() {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Notice | null>(null);
  const token = useRef<HTMLInputElement>(null);
  useEffect(() => token.current?.focus(), []);
  const submit = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    try {
      await signIn({ token: token.current?.value.trim() ?? "" });
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
          {say.token}
          <input ref={token} type="password" name="token" autocomplete="current-password" required maxLength={200} />
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
