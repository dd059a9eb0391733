// Asks before a version is activated, rolled back or retired, and says what that means.

import type { ComponentChildren } from "preact";
import { Confirm } from "../ui/Confirm";
import type { ChangeCall } from "./changeOf";

interface ConfirmChangeProps {
  call: ChangeCall;
  /** Gets what is said of it when it is done. */
  done: (told: string) => void;
  close: () => void;
  children?: ComponentChildren;
}

export function ConfirmChange({ call, done, close, children }: ConfirmChangeProps) {
  const act = async () => {
    await call.act();
    done(call.told);
  };
  return (
    <Confirm {...call} act={act} close={close}>
      <p>{call.text}</p>
      {children}
    </Confirm>
  );
}
