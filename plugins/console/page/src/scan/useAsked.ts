// The scan that is tried: a file, or the body of a recorded query.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { recordedQuery, recordedBody } from "../api/scans";
import { addressed, go, note, route } from "../router";
import { age } from "../ui/text";
import type { Asked } from "./asked";
import { mediaTypeOf } from "./media";
import { spotText } from "./tryState";

/** The scan, and calls that take a file, or another scan, in its place. */
export function useAsked(
  queryId: string,
  problem: Signal<unknown>,
): { asked: Signal<Asked | null>; take: (file: File | undefined) => void; give: (scan: Asked) => void } {
  const asked = useSignal<Asked | null>(null);
  useEffect(() => {
    if (!queryId) return;
    const stop = new AbortController();
    asked.value = null;
    Promise.all([
      recordedQuery(queryId, stop.signal),
      recordedBody(queryId, stop.signal),
    ])
      .then(([recorded, body]) => {
        const name = `Recorded query of ${age(recorded.time)}`;
        asked.value = { name, type: recorded.media_type, encoding: recorded.content_encoding, body };
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      });
    return () => stop.abort();
  }, [queryId]);
  const give = (scan: Asked) => {
    tell(scan.spot ? spotText(scan.spot) : "");
    problem.value = null;
    asked.value = scan; // with the one before goes the answer about it
  };
  const take = (file: File | undefined) => {
    if (file) give({ name: file.name, type: mediaTypeOf(file.name), encoding: "", body: file });
  };
  return { asked, take, give };
}

/** Puts the spot of a simulated scan into the address; "": a file cannot be in it. A recorded query that was there goes. */
function tell(spot: string): void {
  const query = addressed();
  if (!query.has("recorded")) return note({ spot });
  for (const name of ["recorded", "place", "spot"]) query.delete(name);
  go(route.value.path, { ...Object.fromEntries(query), ...(spot ? { spot } : {}) });
}
