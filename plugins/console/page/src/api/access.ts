// Who asks, and the keys that let others ask.

import { api, type Schemas, said } from "./client";

export function callerOfPage() {
  return said(api.GET("/caller"));
}

export function keyList(signal?: AbortSignal) {
  return said(api.GET("/keys", { signal }));
}

export function makeKey(wanted: Schemas["NewKeyBody"]) {
  return said(api.POST("/keys", { body: wanted }));
}

export async function revokeKey(key_id: string): Promise<void> {
  await api.DELETE("/keys/{key_id}", { params: { path: { key_id } } });
}
