// Scans: where they were taken, and the queries that the service kept.

import { api, asRead, Problem, type Schemas, said } from "./client";
import type { operations } from "./schema";

export type LocalizeQuery = NonNullable<operations["localize_localize_post"]["parameters"]["query"]>;
export type EventsQuery = NonNullable<operations["get_answer_events_answers_events_get"]["parameters"]["query"]>;
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

/** The points of a scan at a pose, with what the map says about each, packed. */
export async function overlayPoints(
  map_id: string,
  version: string,
  pose: Schemas["Pose"],
  { type, encoding, body }: ScanBody,
  signal?: AbortSignal,
): Promise<ArrayBuffer> {
  const headers: Record<string, string> = { "Content-Type": type };
  if (encoding) headers["Content-Encoding"] = encoding;
  const { data } = await api.POST("/maps/{map_id}/versions/{version}/overlay", {
    params: { path: { map_id, version }, query: { T_map_sensor: [...pose.position, ...pose.quaternion].join(",") } },
    body: "",
    bodySerializer: () => body,
    parseAs: "arrayBuffer",
    fetch: asRead,
    headers,
    signal,
  });
  return data ?? new ArrayBuffer(0); // a scan without a point
}

/** A stream of answers as they are given: those after a number, of one map or of all. */
export function answerEvents(query: EventsQuery, signal?: AbortSignal) {
  return said(api.GET("/answers/events", { params: { query }, parseAs: "stream", signal }));
}

/** How many queries of each map were answered lately, by the replica that gives the page. */
export function answerCounts(signal?: AbortSignal) {
  return said(api.GET("/answers/counts", { signal }));
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
