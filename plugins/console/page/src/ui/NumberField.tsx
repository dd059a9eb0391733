// A field for a number, which is taken over when its writing has ended: by Enter, or by leaving the field.

import { useSignal } from "@preact/signals";

export interface NumberFieldProps {
  name: string;
  value: number;
  step: number;
  least?: number;
  most?: number;
  /** Gets what was written, also beyond the limits. If it keeps the value as it is, the field shows that again. */
  set: (value: number) => void;
}

export function NumberField({ name, value, step, least, most, set }: NumberFieldProps) {
  // An answer may arrive while somebody writes: it must not take the text away.
  const written = useSignal<string | null>(null);
  return (
    <label>
      {name}
      <input
        type="number"
        step={step}
        min={least}
        max={most}
        value={written.value ?? value}
        onInput={(event) => (written.value = event.currentTarget.value)}
        onChange={(event) => {
          const given = event.currentTarget.valueAsNumber;
          if (Number.isFinite(given)) set(given);
          written.value = null;
        }}
        onBlur={() => (written.value = null)} // also if it was written back, which is no change
      />
    </label>
  );
}
