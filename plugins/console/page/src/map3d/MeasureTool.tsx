import type { Signal } from "@preact/signals";

export interface MeasureToolProps {
  measuring: Signal<boolean>;
  length: Signal<number | null>; // metres
  clear: () => void;
}

/** The distance between two points of the cloud. */
export function MeasureTool({ measuring, length, clear }: MeasureToolProps) {
  return (
    <section>
      <h3>Measure</h3>
      <label class="check">
        <input
          type="checkbox"
          checked={measuring.value}
          onChange={(event) => {
            measuring.value = event.currentTarget.checked;
            clear();
          }}
        />
        Click two points
      </label>
      {length.value === null ? null : <output>{length.value.toFixed(3)} m</output>}
    </section>
  );
}
