// Resumable uploads (tus): a file goes in parts, and after a fault goes on where the service has it.

import { Problem, send } from "../api/client";

const PART_BYTES = 8 << 20;
const TRIES = 6;

/** Sends a file. Returns the upload's id. */
export async function upload(file: File, told: (share: number) => void, signal: AbortSignal): Promise<string> {
  const metadata = `filename ${base64(file.name)}`;
  const begun = await send("POST", "/uploads", {
    headers: { "Tus-Resumable": "1.0.0", "Upload-Length": String(file.size), "Upload-Metadata": metadata },
    signal,
  });
  const id = begun.headers.get("Location")?.split("/").at(-1);
  if (!id) throw new Error("the service did not name the upload");
  let offset = 0;
  let failures = 0;
  while (offset < file.size) {
    try {
      const answer = await send("PATCH", `/uploads/${id}`, {
        headers: {
          "Tus-Resumable": "1.0.0",
          "Upload-Offset": String(offset),
          "Content-Type": "application/offset+octet-stream",
        },
        body: file.slice(offset, offset + PART_BYTES),
        signal,
      });
      offset = Number(answer.headers.get("Upload-Offset"));
      failures = 0;
    } catch (error) {
      const lasts = error instanceof Problem && error.status >= 400 && error.status < 500 && error.status !== 409;
      if (signal.aborted || lasts || ++failures >= TRIES) throw error;
      await new Promise((resume) => setTimeout(resume, 500 * 2 ** failures));
      const known = await send("HEAD", `/uploads/${id}`, { headers: { "Tus-Resumable": "1.0.0" }, signal });
      offset = Number(known.headers.get("Upload-Offset"));
    }
    told(offset / file.size);
  }
  return id;
}

function base64(text: string): string {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
