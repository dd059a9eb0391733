// Maps and their versions.

import { api, said } from "./client";

export function mapPage(signal?: AbortSignal) {
  return said(api.GET("/maps", { params: { query: { limit: 1000 } }, signal }));
}

export function mapDetails(map_id: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}", { params: { path: { map_id } }, signal }));
}

export function versionPage(map_id: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/versions", { params: { path: { map_id }, query: { limit: 1000 } }, signal }));
}

export function versionDetails(map_id: string, version: string, signal?: AbortSignal) {
  return said(api.GET("/maps/{map_id}/versions/{version}", { params: { path: { map_id, version } }, signal }));
}
