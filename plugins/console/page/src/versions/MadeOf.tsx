import type { Schemas } from "../api/client";
import { size } from "../ui/text";

/** What a version was made of, by whom, and what they wrote about it. */
export function MadeOf({ file_name, size_bytes, sha256, trajectory, note, caller, host, command }: Schemas["Provenance"]) {
  const who = [caller, host ? `on ${host}` : ""].filter(Boolean).join(" ");
  return (
    <>
      <span title={sha256 ? `sha256 ${sha256}` : undefined}>
        {file_name || "not recorded"}
        {size_bytes ? ` (${size(size_bytes)})` : ""}
        {trajectory ? ` with ${trajectory}` : ""}
      </span>
      {note ? <q class="note">{note}</q> : null}
      {who ? <small title={command ?? undefined}>by {who}</small> : null}
    </>
  );
}
