import { key } from "../access/session";
import type { LocalizeQuery } from "../api/scans";
import { CopyAs } from "./CopyAs";
import type { Asked } from "./scanFile";

/** The same query for other programs. A file that was taken apart here is read by the command line alone. */
export function Programs({ map, asked, options }: { map: string; asked: Asked; options: LocalizeQuery }) {
  if (asked.isConverted) {
    return (
      <p class="hint">
        On the command line: <code>firstfix localize {asked.name} --map {map}</code>
      </p>
    );
  }
  return (
    <CopyAs
      map={map}
      file={asked.name}
      type={asked.type}
      encoding={asked.encoding}
      options={options}
      isSignedIn={key.value !== ""}
    />
  );
}
