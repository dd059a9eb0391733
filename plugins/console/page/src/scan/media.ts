// Which kind of scan a file is: the service takes these as they are.

const TYPES: Record<string, string> = {
  ".ffscan": "application/vnd.firstfix.scan",
  ".bin": "application/vnd.firstfix.xyzi",
  ".pcd": "application/x-pcd",
  ".ply": "application/ply",
};

export const SUFFIXES = Object.keys(TYPES);

/** File ending of a media type, with or without parameters; "": a file of it cannot be sent as it is. */
export function suffixOf(mediaType: string): string {
  const name = mediaType.split(";")[0]!.trim().toLowerCase();
  return SUFFIXES.find((suffix) => TYPES[suffix] === name) ?? "";
}

/** Media type of a scan file. */
export function mediaTypeOf(fileName: string): string {
  const suffix = /\.[a-z0-9]+$/.exec(fileName.toLowerCase())?.[0] ?? "";
  const type = TYPES[suffix];
  if (!type) throw new Error(`${fileName} is no scan that the service knows: it takes ${SUFFIXES.join(", ")}`);
  return type;
}
