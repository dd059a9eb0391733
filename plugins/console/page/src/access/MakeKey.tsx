// A new key: whose it is, what it may do, and its token, once.

import { useSignal } from "@preact/signals";
import { makeKey } from "../api/access";
import { copy } from "../ui/copy";
import { Dialog } from "../ui/Dialog";
import { ErrorText } from "../ui/ErrorText";

const SCOPES: Record<string, string> = {
  localize: "ask for poses, see maps",
  build: "hand in maps, choose versions, see recorded queries",
  metrics: "read metrics, nothing else",
  admin: "everything",
};

export function MakeKey({ close }: { close: () => void }) {
  const name = useSignal("");
  const scope = useSignal("localize");
  const maps = useSignal("*");
  const days = useSignal("");
  const token = useSignal("");
  const problem = useSignal<unknown>(null);
  const make = async (event: Event) => {
    event.preventDefault();
    try {
      const made = await makeKey({
        name: name.value,
        scopes: [scope.value],
        maps: maps.value.split(/[\s,]+/).filter(Boolean),
        expires_in_days: days.value ? Number(days.value) : null,
      });
      token.value = made.token;
    } catch (error) {
      problem.value = error;
    }
  };
  if (token.value) {
    return (
      <Dialog title={`The key of ${name.value}`} close={close}>
        <p>This is the only time that it is shown.</p>
        <output class="token">{token.value}</output>
        <div class="row end">
          <button onClick={() => copy(token.value)}>Copy</button>
          <button class="primary" onClick={close}>
            Done
          </button>
        </div>
      </Dialog>
    );
  }
  return (
    <Dialog title="Make a key" close={close}>
      <form onSubmit={make}>
        <label>
          Name of its owner
          <input required maxLength={100} value={name.value} onInput={(event) => (name.value = event.currentTarget.value)} />
        </label>
        <label>
          Scope
          <select value={scope.value} onChange={(event) => (scope.value = event.currentTarget.value)}>
            {Object.entries(SCOPES).map(([one, text]) => (
              <option value={one} key={one}>
                {one}: {text}
              </option>
            ))}
          </select>
        </label>
        <label>
          Maps that it may use: ids or patterns with * and ?
          <input required value={maps.value} onInput={(event) => (maps.value = event.currentTarget.value)} />
        </label>
        <label>
          Days until it expires
          <input
            type="number"
            min={1}
            max={36500}
            placeholder="never"
            value={days.value}
            onInput={(event) => (days.value = event.currentTarget.value)}
          />
        </label>
        {problem.value ? <ErrorText error={problem.value} /> : null}
        <div class="row end">
          <button type="button" onClick={close}>
            Cancel
          </button>
          <button class="primary">Make it</button>
        </div>
      </form>
    </Dialog>
  );
}
