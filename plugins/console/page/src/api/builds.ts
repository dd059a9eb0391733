// Builds of maps: what they are made of, and how far they are.

import { api, type Schemas, said } from "./client";
import { follow } from "./events";

type Build = Schemas["Build"];
export type BuildOptions = Partial<Schemas["BuildConfig"]>;

export function sensorList(signal?: AbortSignal) {
  return said(api.GET("/sensors", { signal }));
}

/** The last builds, the newest first: of one map, or of all. */
export function lastBuilds(limit: number, map_id?: string) {
  return said(api.GET("/builds", { params: { query: { limit, map_id } } }));
}

/** One build, with its stages that have ended, and what it was made of. */
export function buildDetails(build_id: string, signal?: AbortSignal) {
  return said(api.GET("/builds/{build_id}", { params: { path: { build_id } }, signal }));
}

/** The end of the log of a build's processes. */
export function buildLog(build_id: string, signal?: AbortSignal) {
  return said(api.GET("/builds/{build_id}/log", { params: { path: { build_id } }, parseAs: "text", signal }));
}

/** Begins a build from files that were uploaded. */
export function beginBuild(map_id: string, source: string, trajectory: string | null, config: BuildOptions) {
  return said(
    api.POST("/maps", {
      params: { header: { "idempotency-key": `console-${source}` } },
      body: { map_id, source: { upload: source }, trajectory: trajectory ? { upload: trajectory } : null },
      // openapi.json knows options with a default as given: the service fills in those that are left out
      bodySerializer: (body) => JSON.stringify({ ...body, config }),
    }),
  );
}

export async function cancelBuild(build_id: string): Promise<void> {
  await api.DELETE("/builds/{build_id}", { params: { path: { build_id } } });
}

/** Calls `take` at every change of a build, and with the last one. */
export function followBuild(build_id: string, take: (build: Build, isEnd: boolean) => void, signal: AbortSignal) {
  return follow(
    () => said(api.GET("/builds/{build_id}/events", { params: { path: { build_id } }, parseAs: "stream", signal })),
    ({ name, data }) => take(data as Build, name === "end"), // openapi.json knows a stream as a text
    signal,
  );
}
