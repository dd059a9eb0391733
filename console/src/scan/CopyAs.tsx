import { useSignal } from "@preact/signals";
import type { Query } from "../api/client";
import { copy } from "../ui/copy";
import { asCurl, asPython } from "./copyAs";

/** Buttons that copy the query for other programs. */
export function CopyAs({ map, file, type, options }: { map: string; file: string; type: string; options: Query }) {
  const copied = useSignal("");
  const forms: Record<string, string> = {
    curl: asCurl(map, file, type, options),
    Python: asPython(map, file, options),
  };
  return (
    <div class="row">
      {Object.entries(forms).map(([name, text]) => (
        <button
          key={name}
          onClick={async () => {
            await copy(text);
            copied.value = name;
          }}
        >
          Copy as {name}
        </button>
      ))}
      <span role="status">{copied.value ? `${copied.value} copied` : ""}</span>
    </div>
  );
}
