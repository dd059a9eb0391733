// Deleting a map, after its name was typed.

import { useSignal } from "@preact/signals";
import { change } from "../api/client";
import { Dialog } from "../ui/Dialog";
import { ErrorText } from "../ui/ErrorText";

export function DeleteMap({ map, close, done }: { map: string; close: () => void; done: () => void }) {
  const typed = useSignal("");
  const problem = useSignal<unknown>(null);
  const remove = async (event: Event) => {
    event.preventDefault();
    try {
      await change("DELETE", `/maps/${map}`);
      done();
    } catch (error) {
      problem.value = error;
    }
  };
  return (
    <Dialog title={`Delete the map ${map}`} close={close}>
      <form onSubmit={remove}>
        <p>All its versions are taken out of service. The next garbage collection removes their files for good.</p>
        <label>
          Type the map's name
          <input value={typed.value} autocomplete="off" onInput={(event) => (typed.value = event.currentTarget.value)} />
        </label>
        {problem.value ? <ErrorText error={problem.value} /> : null}
        <div class="row end">
          <button type="button" onClick={close}>
            Keep it
          </button>
          <button class="danger" disabled={typed.value !== map}>
            Delete
          </button>
        </div>
      </form>
    </Dialog>
  );
}
