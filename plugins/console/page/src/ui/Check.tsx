import type { Signal } from "@preact/signals";
import type { ComponentChildren } from "preact";

/** A switch with its text. */
export function Check({ value, children }: { value: Signal<boolean>; children: ComponentChildren }) {
  return (
    <label class="check">
      <input type="checkbox" checked={value.value} onChange={(event) => (value.value = event.currentTarget.checked)} />
      {children}
    </label>
  );
}
