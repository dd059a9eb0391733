// Hands in the files of a map with the config of its build.

import { beginBuild, type BuildOptions } from "../api/builds";
import type { MapFile } from "./files";
import { upload } from "./upload";
import { zipped } from "./zip";

/** `told` hears what is done, and how much of it. */
export async function handIn(
  map: string,
  files: MapFile[],
  trajectory: File | null,
  config: BuildOptions,
  told: (label: string, share: number) => void,
  signal: AbortSignal,
): Promise<void> {
  told("Reading", 0);
  const reading = (share: number) => told("Reading", share);
  const source = files.length === 1 ? files[0]!.file : await zipped(files, reading, signal);
  const id = await upload(source, (share) => told("Uploading", share), signal);
  const poses = trajectory && (await upload(trajectory, () => {}, signal));
  await beginBuild(map, id, poses, config);
}
