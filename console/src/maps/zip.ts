// A zip of several files, stored without compression: the service takes a folder as an archive.

import type { MapFile } from "./files";

const TABLE = Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n >>> 0;
});
const MOST_BYTES = 0xffffffff; // of a zip without its 64-bit extension
const MOST_ENTRY_BYTES = 76 + 2 * 4096; // that a file's two records take, with its path in both

/** Packs files under their paths. Reads all of them once, for their check sums. */
export async function zipped(
  files: MapFile[],
  told: (share: number) => void = () => {},
  signal?: AbortSignal,
): Promise<File> {
  const all = files.reduce((sum, { file }) => sum + file.size, 0);
  if (all > MOST_BYTES - files.length * MOST_ENTRY_BYTES || files.length > 0xffff) {
    throw new Error("The folder is larger than 4 GB. Pack it yourself, or use the command line.");
  }
  const parts: BlobPart[] = [];
  const entries: { name: Uint8Array<ArrayBuffer>; crc: number; size: number; at: number }[] = [];
  let at = 0;
  let read = 0;
  for (const { path, file } of files) {
    const name = new TextEncoder().encode(path);
    const crc = await crcOf(file, (bytes) => {
      signal?.throwIfAborted();
      told((read += bytes) / all);
    });
    entries.push({ name, crc, size: file.size, at });
    const head = record(30, [0x04034b50, 4], [20, 2], [0x800, 2], [0, 2], [0, 2], [0x21, 2], [crc, 4], [file.size, 4], [file.size, 4], [name.length, 2], [0, 2]);
    parts.push(head, name, file);
    at += 30 + name.length + file.size;
  }
  const directoryAt = at;
  for (const { name, crc, size, at: where } of entries) {
    const head = record(46, [0x02014b50, 4], [20, 2], [20, 2], [0x800, 2], [0, 2], [0, 2], [0x21, 2], [crc, 4], [size, 4], [size, 4], [name.length, 2], [0, 2], [0, 2], [0, 2], [0, 2], [0, 4], [where, 4]);
    parts.push(head, name);
    at += 46 + name.length;
  }
  const n = entries.length;
  parts.push(record(22, [0x06054b50, 4], [0, 2], [0, 2], [n, 2], [n, 2], [at - directoryAt, 4], [directoryAt, 4], [0, 2]));
  return new File(parts, "map.zip", { type: "application/zip" });
}

function record(length: number, ...fields: [number, 2 | 4][]): Uint8Array<ArrayBuffer> {
  const view = new DataView(new ArrayBuffer(length));
  let at = 0;
  for (const [value, bytes] of fields) {
    if (bytes === 2) view.setUint16(at, value, true);
    else view.setUint32(at, value >>> 0, true);
    at += bytes;
  }
  return new Uint8Array(view.buffer);
}

async function crcOf(file: File, told: (bytes: number) => void): Promise<number> {
  let crc = 0xffffffff;
  const reader = file.stream().getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return (crc ^ 0xffffffff) >>> 0;
    for (const byte of value) crc = TABLE[(crc ^ byte) & 0xff]! ^ (crc >>> 8);
    told(value.length);
  }
}
