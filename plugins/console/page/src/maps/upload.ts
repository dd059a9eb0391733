// Uploads that outlive a fault: a file goes in parts, and after a fault goes on where the service has it.

import { Problem } from "../api/client";
import { appendToUpload, beginUpload, uploadOffset } from "../api/uploads";

const PART_BYTES = 8 << 20;
const TRIES = 6;

/** Sends a file. Returns the upload's id. */
export async function upload(file: File, told: (share: number) => void, signal: AbortSignal): Promise<string> {
  const id = await beginUpload(file, signal);
  let offset = 0;
  let failures = 0;
  while (offset < file.size) {
    try {
      offset = await appendToUpload(id, offset, file.slice(offset, offset + PART_BYTES), signal);
      failures = 0;
    } catch (error) {
      const lasts = error instanceof Problem && error.status >= 400 && error.status < 500 && error.status !== 409;
      if (signal.aborted || lasts || ++failures >= TRIES) throw error;
      await new Promise((resume) => setTimeout(resume, 500 * 2 ** failures));
      offset = await uploadOffset(id, signal);
    }
    told(offset / file.size);
  }
  return id;
}
