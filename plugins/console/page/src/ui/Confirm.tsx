// The question before a change that robots feel or that nobody can take back: it names what happens.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { Dialog } from "./Dialog";
import { ErrorText } from "./ErrorText";

/** What is asked, and what is done then. */
export interface Question {
  title: string;
  /** What the button says: "Retire". */
  action: string;
  /** What the other button says: "Keep it". */
  keep: string;
  /** What must be typed before the button works, and how it is called. */
  typed?: { name: string; text: string };
  act: () => Promise<unknown>;
}

export interface ConfirmProps extends Question {
  close: () => void;
  /** What happens. */
  children: ComponentChildren;
}

export function Confirm({ title, action, keep, typed, act, close, children }: ConfirmProps) {
  const given = useSignal("");
  const isBusy = useSignal(false);
  const problem = useSignal<unknown>(null);
  const confirm = async (event: Event) => {
    event.preventDefault();
    if (isBusy.value) return;
    isBusy.value = true;
    problem.value = null;
    try {
      await act();
      close();
    } catch (error) {
      problem.value = error;
      isBusy.value = false;
    }
  };
  return (
    <Dialog title={title} close={close}>
      <form onSubmit={confirm}>
        <div>{children}</div>
        {typed ? (
          <label>
            Type {typed.name}: {typed.text}
            <input value={given.value} autocomplete="off" onInput={(event) => (given.value = event.currentTarget.value)} />
          </label>
        ) : null}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        <div class="row end">
          <button type="button" onClick={close}>
            {keep}
          </button>
          <button class="danger" disabled={isBusy.value || (typed !== undefined && given.value !== typed.text)}>
            {action}
          </button>
        </div>
      </form>
    </Dialog>
  );
}
