// A scan file as the service takes it. What the service does not read is taken apart here, and its points are sent.

import { laz, las } from "./formats/las";
import { npy } from "./formats/npy";
import type { Points } from "./formats/points";
import { text } from "./formats/text";
import { mediaTypeOf, SUFFIXES } from "./media";

/** The scan that is tried, as it is sent. */
export interface Asked {
  name: string;
  type: string;
  encoding: string;
  body: Blob;
  isConverted: boolean; // the body is not the file's: programs cannot send the file as it is
  spot?: readonly number[]; // of the map, at which it was simulated; else there is none
}

const READERS: Record<string, (body: ArrayBuffer) => Points> = {
  ".npy": npy,
  ".las": las,
  ".laz": laz,
  ".csv": text,
  ".xyz": text,
  ".txt": text,
  ".pts": text,
};
const RECORDINGS = [".bag", ".mcap", ".db3"];
const XYZ = "application/vnd.firstfix.xyz";
const MAX_BYTES = 256e6;

/** What the file's dialog offers. */
export const READABLE = [...SUFFIXES, ...Object.keys(READERS)];

/** Reads a file by its ending. Throws what a person can act on. */
export async function scanOf(file: File): Promise<Asked> {
  const suffix = /\.[a-z0-9]+$/.exec(file.name.toLowerCase())?.[0] ?? "";
  if (RECORDINGS.includes(suffix)) {
    throw new Error(`${file.name} is a recording of many scans. On the command line: firstfix localize --bag ${file.name} --map MAP`);
  }
  const read = READERS[suffix];
  if (!read) {
    if (!SUFFIXES.includes(suffix)) {
      throw new Error(`${file.name} is no scan that the console knows: it takes ${READABLE.join(", ")}`);
    }
    return { name: file.name, type: mediaTypeOf(file.name), encoding: "", body: file, isConverted: false };
  }
  if (file.size > MAX_BYTES) throw new Error(`${file.name} is larger than 256 MB: one scan is not.`);
  const points = readNamed(file.name, await file.arrayBuffer(), read);
  return { name: file.name, type: XYZ, encoding: "", body: new Blob([points]), isConverted: true };
}

function readNamed(name: string, body: ArrayBuffer, read: (body: ArrayBuffer) => Points): Points {
  let points: Points;
  try {
    points = read(body);
  } catch (error) {
    throw new Error(`${name}: ${error instanceof Error ? error.message : String(error)}`, { cause: error });
  }
  if (!points.length) throw new Error(`${name} has no points.`);
  return points;
}
