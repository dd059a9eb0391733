// The gate: it asks the service who the caller is, and for a key where it needs one.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useLayoutEffect } from "preact/hooks";
import { callerOfPage } from "../api/access";
import { Problem } from "../api/client";
import { ErrorText } from "../ui/ErrorText";
import { caller, key, refusal, signIn } from "./session";

export function Gate({ children }: { children: ComponentChildren }) {
  const problem = useSignal<unknown>(null);
  const wanted = useSignal(false);
  useLayoutEffect(() => {
    let current = true;
    callerOfPage()
      .then((found) => {
        if (!current) return;
        caller.value = found;
        problem.value = null;
      })
      .catch((error: unknown) => {
        if (error instanceof Problem && error.status === 401) wanted.value = true;
        else if (current) problem.value = error;
      });
    return () => {
      current = false;
    };
  }, [key.value]);
  if (caller.value) return <>{children}</>;
  if (wanted.value || refusal.value) return <SignIn problem={refusal.value ?? problem.value} />;
  if (problem.value) return <ErrorText error={problem.value} again={() => location.reload()} />;
  return (
    <p class="wait" role="status">
      Asking the service …
    </p>
  );
}

function SignIn({ problem }: { problem: unknown }) {
  const given = useSignal("");
  const keep = useSignal(true);
  return (
    <main class="sign-in">
      <h1>firstfix</h1>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          signIn(given.value.trim(), keep.value);
        }}
      >
        <label>
          API key or token
          <input
            type="password"
            autocomplete="off"
            required
            value={given.value}
            onInput={(event) => (given.value = event.currentTarget.value)}
          />
        </label>
        <label class="check">
          <input
            type="checkbox"
            checked={keep.value}
            onChange={(event) => (keep.value = event.currentTarget.checked)}
          />
          Keep it until this tab is closed
        </label>
        <button class="primary">Sign in</button>
        {problem ? <ErrorText error={problem} /> : null}
      </form>
      <p class="hint">
        <code>firstfix keys create NAME</code> gives out a key.
      </p>
    </main>
  );
}
