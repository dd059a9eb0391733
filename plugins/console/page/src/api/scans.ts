// Scans: where they were taken, and the queries that the service recorded.

import { api, asRead, Problem, type Schemas, said } from "./client";
import type { operations } from "./schema";

export type LocalizeQuery = NonNullable<operations["localize_localize_post"]["parameters"]["query"]>;
export type EventsQuery = NonNullable<operations["get_answer_events_answers_events_get"]["parameters"]["query"]>;
export type RecordedFilter = NonNullable<operations["get_recorded_queries_recorded_queries_get"]["parameters"]["query"]>;

interface ScanBody {
  type: string;
  encoding: string; // of the content: gzip, zstd or none
  body: Blob;
}

export async function localize({ type, encoding, body }: ScanBody, query: LocalizeQuery, signal?: AbortSignal) {
  // A query with such an id is not recorded: it was recorded already, or a person only tries it.
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

/** What the service understands of a scan, without asking a map. */
export function scanReport({ type, encoding, body }: ScanBody, signal?: AbortSignal) {
  const headers: Record<string, string> = { "Content-Type": type };
  if (encoding) headers["Content-Encoding"] = encoding;
  return said(api.POST("/scan-report", { body: "", bodySerializer: () => body, fetch: asRead, headers, signal }));
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

/** The map that the replica answered about last; "": it answered none since it started. */
export async function lastAskedMap(signal?: AbortSignal): Promise<string> {
  const { maps } = await answerCounts(signal);
  return maps.reduce((last, one) => (one.last_time > last.last_time ? one : last), { map_id: "", last_time: "" }).map_id;
}

export function recordedPage(query: RecordedFilter, signal?: AbortSignal) {
  return said(api.GET("/recorded-queries", { params: { query }, signal }));
}

export function recordedQuery(query_id: string, signal?: AbortSignal) {
  return said(api.GET("/recorded-queries/{query_id}", { params: { path: { query_id } }, signal }));
}

export function recordedBody(query_id: string, signal?: AbortSignal) {
  return said(api.GET("/recorded-queries/{query_id}/body", { params: { path: { query_id } }, parseAs: "blob", signal }));
}

export async function removeRecorded(query_id: string): Promise<void> {
  await api.DELETE("/recorded-queries/{query_id}", { params: { path: { query_id } } });
}

/** Says where a recorded query was taken; null: not in this map. */
export function tellTruth(query_id: string, map_id: string, T_map_sensor: Schemas["Pose"] | null) {
  return said(api.PUT("/recorded-queries/{query_id}/truth", { params: { path: { query_id } }, body: { map_id, T_map_sensor } }));
}
