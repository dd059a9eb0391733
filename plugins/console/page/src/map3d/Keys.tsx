import type { Signal } from "@preact/signals";
import { Dialog } from "../ui/Dialog";
import { CAMERA_KEYS, KEYS } from "./cameraKeys";

/** The hint of the keyboard in the picture, and its list. */
export function Keys({ isAsked }: { isAsked: Signal<boolean> }) {
  return (
    <div class="keys">
      <p>{KEYS}</p>
      <button onClick={() => (isAsked.value = true)}>Keyboard: ?</button>
      {isAsked.value ? (
        <Dialog title="The map by keyboard" close={() => (isAsked.value = false)}>
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
