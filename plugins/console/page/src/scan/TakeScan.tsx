// Where the scan comes from: a file, or a recorded query.

import { mayBuild } from "../access/session";
import { recordedPage } from "../api/scans";
import { addressed, go, route } from "../router";
import { age } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { SUFFIXES } from "./media";

const LISTED = 20;

export interface TakeScanProps {
  map: string;
  name: string; // of the scan that is tried; "": none yet
  take: (file: File | undefined) => void;
}

export function TakeScan({ map, name, take }: TakeScanProps) {
  return (
    <>
      <label class="drop">
        <span>{name || "Drop a scan here, or choose a file"}</span>
        {name ? null : <small>{SUFFIXES.join(", ")}</small>}
        <input type="file" accept={SUFFIXES.join(",")} onChange={(event) => take(event.currentTarget.files?.[0])} />
      </label>
      {mayBuild.value ? <RecordedQueries map={map} /> : null}
    </>
  );
}

function RecordedQueries({ map }: { map: string }) {
  const page = useLoaded(
    (signal) => recordedPage({ map_id: map, limit: LISTED }, signal),
    [map],
  );
  const queries = page.value?.queries ?? [];
  if (!queries.length) return null;
  const choose = (queryId: string) => {
    const query = addressed();
    for (const name of ["spot", "place"]) query.delete(name); // of the scan before
    queryId ? query.set("recorded", queryId) : query.delete("recorded");
    go(route.value.path, Object.fromEntries(query));
  };
  return (
    <label>
      Or one that a robot asked
      <select value={route.value.query.get("recorded") ?? ""} onChange={(event) => choose(event.currentTarget.value)}>
        <option value="">none</option>
        {queries.map((one) => (
          <option key={one.query_id} value={one.query_id}>
            {String(one.answer.verdict)}, {age(one.time)}
          </option>
        ))}
      </select>
    </label>
  );
}
