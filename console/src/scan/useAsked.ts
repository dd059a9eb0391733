// The scan that is tried: a file, or the body of a kept query.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { get, type Schemas, send } from "../api/client";
import { mediaTypeOf } from "./media";

export interface Asked {
  name: string;
  type: string;
  encoding: string;
  body: Blob;
}

/** The scan, and a call that takes a file in its place. */
export function useAsked(
  sampleId: string,
  problem: Signal<unknown>,
): { asked: Signal<Asked | null>; take: (file: File | undefined) => void } {
  const asked = useSignal<Asked | null>(null);
  useEffect(() => {
    if (!sampleId) return;
    const stop = new AbortController();
    Promise.all([
      get<Schemas["Sample"]>(`/samples/${sampleId}`, {}, stop.signal),
      send("GET", `/samples/${sampleId}/body`, { signal: stop.signal }).then((found) => found.blob()),
    ])
      .then(([sample, body]) => {
        asked.value = { name: sampleId, type: sample.media_type, encoding: sample.content_encoding, body };
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      });
    return () => stop.abort();
  }, [sampleId]);
  const take = (file: File | undefined) => {
    if (!file) return;
    try {
      asked.value = { name: file.name, type: mediaTypeOf(file.name), encoding: "", body: file };
    } catch (error) {
      problem.value = error;
    }
  };
  return { asked, take };
}
