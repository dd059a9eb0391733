// A zip of several files, stored without compression: the service takes a folder as an archive.

import { Zip, ZipPassThrough } from "fflate";
import type { MapFile } from "./files";

const MAX_BYTES = 0xffffffff; // of a zip without its 64-bit extension
const MAX_ENTRY_BYTES = 92 + 2 * 4096; // that a file's records take, with its path in two of them
const WRITTEN = new Date(1980, 0, 1); // the earliest that a zip can say: the same files make the same zip

/** Packs files under their paths. Reads all of them once, for their check sums. */
export async function zipped(
  files: MapFile[],
  told: (share: number) => void = () => {},
  signal?: AbortSignal,
): Promise<File> {
  const all = files.reduce((sum, { file }) => sum + file.size, 0);
  if (all > MAX_BYTES - files.length * MAX_ENTRY_BYTES || files.length > 0xffff) {
    throw new Error("The folder is larger than 4 GB. Pack it yourself, or use the command line.");
  }
  const parts: BlobPart[] = [];
  let content: Uint8Array | undefined;
  const zip = new Zip((error, written) => {
    if (error) throw error;
    if (written !== content) parts.push(written);
  });
  let read = 0;
  for (const { path, file } of files) {
    const entry = new ZipPassThrough(path);
    entry.mtime = WRITTEN;
    zip.add(entry);
    const reader = file.stream().getReader();
    while ((content = (await reader.read()).value)) {
      signal?.throwIfAborted();
      entry.push(content);
      told((read += content.length) / all);
    }
    parts.push(file); // after its head, by reference: no content is held in memory
    entry.push(new Uint8Array(), true);
  }
  zip.end();
  return new File(parts, "map.zip", { type: "application/zip" });
}
