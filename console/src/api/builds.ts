// Builds of maps: how far they are.

import { api, said } from "./client";

/** The last builds, the newest first: of one map, or of all. */
export function lastBuilds(limit: number, map_id?: string) {
  return said(api.GET("/builds", { params: { query: { limit, map_id } } }));
}
