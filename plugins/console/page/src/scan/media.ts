// Which kind of scan a file is, and what the file of one is called.

const TYPES: Record<string, string> = {
  ".ffscan": "application/vnd.firstfix.scan",
  ".bin": "application/vnd.firstfix.xyzi",
  ".pcd": "application/x-pcd",
  ".ply": "application/ply",
  ".npy": "application/x-npy",
  ".las": "application/vnd.las",
  ".laz": "application/vnd.las",
  ".csv": "text/csv",
  ".xyz": "text/csv",
  ".txt": "text/csv",
  ".pts": "text/csv",
};
const UNKNOWN = "application/octet-stream"; // the service looks at the first bytes

/** What the file's dialog offers. */
export const SUFFIXES = Object.keys(TYPES);

/** File ending of a media type, with or without parameters; "": a body of it is not kept as a file. */
export function suffixOf(mediaType: string): string {
  const name = mediaType.split(";")[0]!.trim().toLowerCase();
  return SUFFIXES.find((suffix) => TYPES[suffix] === name) ?? "";
}

/** Media type of a scan file. */
export function mediaTypeOf(fileName: string): string {
  const suffix = /\.[a-z0-9]+$/.exec(fileName.toLowerCase())?.[0] ?? "";
  return TYPES[suffix] ?? UNKNOWN;
}
