// The probability from which on an answer is localized: the map's own, unless somebody gives another one.

import type { Signal } from "@preact/signals";

/** `least`: as it was given; "": the map's own. */
export function LeastField({ least, ofMap }: { least: Signal<string>; ofMap: number }) {
  return (
    <div class="field">
      <label>
        Least probability, {least.value ? `instead of the map's ${ofMap}` : "of the map"}
        <input
          type="number"
          min={0}
          max={1}
          step={0.001}
          value={least.value || ofMap}
          onChange={(event) => {
            const { valueAsNumber: given, validity } = event.currentTarget;
            if (Number.isFinite(given) && !validity.rangeOverflow && !validity.rangeUnderflow) least.value = String(given);
            else event.currentTarget.value = least.value || String(ofMap);
          }}
        />
      </label>
      {least.value ? <button onClick={() => (least.value = "")}>As the map has it</button> : null}
    </div>
  );
}
