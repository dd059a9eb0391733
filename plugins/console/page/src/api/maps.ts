// Maps and their versions.

import { api, Problem, type Schemas, said } from "./client";
import type { operations } from "./schema";

// As the calls give them: openapi-fetch knows tuples as arrays.
export type CloudIndex = Awaited<ReturnType<typeof cloudIndex>>;
export type MapChanges = Awaited<ReturnType<typeof mapChanges>>;
export type ChangesQuery = NonNullable<operations["get_changes_maps__map_id__changes_get"]["parameters"]["query"]>;

const MAX_LISTED = 1000;

export function mapPage(signal?: AbortSignal) {
  return said(api.GET("/maps", { params: { query: { limit: MAX_LISTED } }, signal }));
}

export function mapDetails(map_id: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}", { params: { path: { map_id } }, signal }));
}

export async function deleteMap(map_id: string): Promise<void> {
  await api.DELETE("/maps/{map_id}", { params: { path: { map_id } } });
}

/** What the queries show to have changed since the version was made. */
export function mapChanges(map_id: string, query: ChangesQuery, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/changes", { params: { path: { map_id }, query }, signal }));
}

export function versionPage(map_id: string, signal?: AbortSignal, limit = MAX_LISTED) {
  return said(api.GET("/maps/{map_id}/versions", { params: { path: { map_id }, query: { limit } }, signal }));
}

export function versionDetails(map_id: string, version: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/versions/{version}", { params: { path: { map_id, version } }, signal }));
}

export function versionReport(map_id: string, version: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/versions/{version}/report", { params: { path: { map_id, version } }, signal }));
}

/** A small picture of a version's map from above. */
export function thumbnail(map_id: string, version: string, signal?: AbortSignal) {
  return said(
    api.GET("/maps/{map_id}/versions/{version}/thumbnail", {
      params: { path: { map_id, version } },
      parseAs: "blob",
      signal,
    }),
  );
}

/** The files for viewers that the service writes. */
export function viewerFormats(signal?: AbortSignal) {
  return said(api.GET("/viewer-formats", { signal }));
}

/** A version's map with the newest recorded queries, for Foxglove, RViz or rerun. */
export function viewerFile(map_id: string, version: string, format: Schemas["ViewerFormat"]["format"], queries: number) {
  return said(
    api.GET("/maps/{map_id}/versions/{version}/viewer-file", {
      params: { path: { map_id, version }, query: { format, queries } },
      parseAs: "blob",
    }),
  );
}

export function activateVersion(map_id: string, version: string) {
  return said(api.POST("/maps/{map_id}/versions/{version}/activate", { params: { path: { map_id, version } } }));
}

export async function retireVersion(map_id: string, version: string): Promise<void> {
  await api.DELETE("/maps/{map_id}/versions/{version}", { params: { path: { map_id, version } } });
}

/** Activates the version that was active before. */
export function rollBack(map_id: string) {
  return said(api.POST("/maps/{map_id}/rollback", { params: { path: { map_id } } }));
}

export function cloudIndex(map_id: string, version: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/versions/{version}/cloud", { params: { path: { map_id, version } }, signal }));
}

export function cloudPoints(map_id: string, version: string, first: number, count: number, signal?: AbortSignal) {
  return said(
    api.GET("/maps/{map_id}/versions/{version}/cloud/points", {
      params: { path: { map_id, version }, query: { first, count } },
      parseAs: "arrayBuffer",
      signal,
    }),
  );
}

export function cloudIntensity(map_id: string, version: string, first: number, count: number, signal?: AbortSignal) {
  return said(
    api.GET("/maps/{map_id}/versions/{version}/cloud/intensity", {
      params: { path: { map_id, version }, query: { first, count } },
      parseAs: "arrayBuffer",
      signal,
    }),
  );
}

/** Where a map lies on the Earth; null: nobody has told. */
export async function placeOf(map_id: string, signal?: AbortSignal): Promise<Schemas["GeoreferenceRecord"] | null> {
  try {
    return await said(api.GET("/maps/{map_id}/georeference", { params: { path: { map_id } }, signal }));
  } catch (error) {
    if (error instanceof Problem && error.code === "not_found") return null;
    throw error;
  }
}

export function setPlace(map_id: string, place: Schemas["GeoreferenceBody"]) {
  return said(api.PUT("/maps/{map_id}/georeference", { params: { path: { map_id } }, body: place }));
}

export async function removePlace(map_id: string): Promise<void> {
  await api.DELETE("/maps/{map_id}/georeference", { params: { path: { map_id } } });
}
