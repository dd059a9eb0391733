// The probability from which on an answer is localized: the map's own, unless somebody gives another one.

import type { Signal } from "@preact/signals";
import { NumberField } from "../ui/NumberField";

/** `least`: as it was given; "": the map's own. */
export function LeastField({ least, ofMap }: { least: Signal<string>; ofMap: number }) {
  return (
    <div class="field">
      <NumberField
        name={`Least probability, ${least.value ? `instead of the map's ${ofMap}` : "of the map"}`}
        value={least.value ? Number(least.value) : ofMap}
        step={0.001}
        least={0}
        most={1}
        set={(given) => {
          if (given >= 0 && given <= 1) least.value = String(given);
        }}
      />
      {least.value ? <button onClick={() => (least.value = "")}>As the map has it</button> : null}
    </div>
  );
}
