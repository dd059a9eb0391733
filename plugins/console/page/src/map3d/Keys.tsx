import type { Signal } from "@preact/signals";
import { Dialog } from "../ui/Dialog";
import { CAMERA_KEYS, KEYS } from "./cameraKeys";

/** The hint of the keys in the picture, and their list. */
export function Keys({ isAsked }: { isAsked: Signal<boolean> }) {
  return (
    <div class="keys">
      <p>{KEYS}</p>
      <button onClick={() => (isAsked.value = true)}>Keys: ?</button>
      {isAsked.value ? (
        <Dialog title="Keys of the map" close={() => (isAsked.value = false)}>
          <dl class="key-list">
            {CAMERA_KEYS.map(([keys, text]) => (
              <div key={keys}>
                <dt>
                  <kbd>{keys}</kbd>
                </dt>
                <dd>{text}</dd>
              </div>
            ))}
          </dl>
          <button onClick={() => (isAsked.value = false)}>Close</button>
        </Dialog>
      ) : null}
    </div>
  );
}
