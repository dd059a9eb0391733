// Scans: where they were taken, and the queries that the service kept.

import { api, Problem, type Schemas, said } from "./client";
import type { operations } from "./schema";

export type LocalizeQuery = NonNullable<operations["localize_localize_post"]["parameters"]["query"]>;
export type SampleQuery = NonNullable<operations["get_samples_samples_get"]["parameters"]["query"]>;

interface ScanBody {
  type: string;
  encoding: string; // of the content: gzip, zstd or none
  body: Blob;
}

export async function localize({ type, encoding, body }: ScanBody, query: LocalizeQuery, signal?: AbortSignal) {
  // A query with such an id is not kept: it was kept already, or a person only tries it.
  const headers: Record<string, string> = { "Content-Type": type, "X-Request-Id": `replay-console-${Date.now()}` };
  if (encoding) headers["Content-Encoding"] = encoding;
  // openapi.json knows bytes as texts: they are sent as they are
  const answer = await said(
    api.POST("/localize", { params: { query }, body: "", bodySerializer: () => body, headers, signal }),
  );
  if (typeof answer === "string" || !("verdict" in answer)) {
    throw new Problem(0, "unknown", "The service gave a message where an answer was asked for.");
  }
  return answer;
}

export function samplePage(query: SampleQuery, signal?: AbortSignal) {
  return said(api.GET("/samples", { params: { query }, signal }));
}

export function sample(sample_id: string, signal?: AbortSignal) {
  return said(api.GET("/samples/{sample_id}", { params: { path: { sample_id } }, signal }));
}

export function sampleBody(sample_id: string, signal?: AbortSignal) {
  return said(api.GET("/samples/{sample_id}/body", { params: { path: { sample_id } }, parseAs: "blob", signal }));
}

export async function removeSample(sample_id: string): Promise<void> {
  await api.DELETE("/samples/{sample_id}", { params: { path: { sample_id } } });
}

/** Says where a kept query was taken; null: not in this map. */
export function tellTruth(sample_id: string, map_id: string, T_map_sensor: Schemas["Pose"] | null) {
  return said(api.PUT("/samples/{sample_id}/truth", { params: { path: { sample_id } }, body: { map_id, T_map_sensor } }));
}
