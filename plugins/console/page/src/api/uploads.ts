// Resumable uploads, as the tus protocol has them.

import { api, said } from "./client";

const TUS = { "tus-resumable": "1.0.0" };

/** Begins to upload a file. Returns the upload's id. */
export async function beginUpload(file: File, signal?: AbortSignal): Promise<string> {
  const header = { ...TUS, "upload-length": String(file.size), "upload-metadata": `filename ${base64(file.name)}` };
  return (await said(api.POST("/uploads", { params: { header }, signal }))).upload_id;
}

/** Sends a part, which begins at `offset`. Returns where the next one begins. */
export async function appendToUpload(upload_id: string, offset: number, part: Blob, signal?: AbortSignal): Promise<number> {
  const { response } = await api.PATCH("/uploads/{upload_id}", {
    params: { path: { upload_id }, header: { ...TUS, "upload-offset": String(offset) } },
    headers: { "Content-Type": "application/offset+octet-stream" },
    body: "",
    bodySerializer: () => part, // openapi.json knows bytes as texts: they are sent as they are
    signal,
  });
  return offsetOf(response);
}

/** How many bytes the service has. */
export async function uploadOffset(upload_id: string, signal?: AbortSignal): Promise<number> {
  const { response } = await api.HEAD("/uploads/{upload_id}", { params: { path: { upload_id }, header: TUS }, signal });
  return offsetOf(response);
}

function offsetOf(response: Response): number {
  return Number(response.headers.get("Upload-Offset"));
}

function base64(text: string): string {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
