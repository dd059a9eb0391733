// The files of a map as somebody gives them: dropped or chosen, alone or in folders.

export interface MapFile {
  path: string; // from the folder that was given: "hall/scans/1.pcd"
  file: File;
}

/** Files that were dropped, and those of dropped folders. Hidden files are left out, as the service leaves them out. */
export async function dropped(data: DataTransfer): Promise<MapFile[]> {
  // all at once: the browser empties the list when the handler of the drop returns
  const entries = [...data.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  return checked((await Promise.all(entries.map((entry) => filesOf(entry, "")))).flat(), entries.length);
}

/** Files that were chosen in the browser's dialog, of one folder or none. */
export function chosen(files: FileList | null): MapFile[] {
  const all = [...(files ?? [])].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
  return checked(all.filter(({ path }) => !path.split("/").some(isHidden)), all.length);
}

/** The folder that all files are from, or null for files without one. */
export function folderOf(files: MapFile[]): string | null {
  const tops = new Set(files.map(({ path }) => (path.includes("/") ? path.split("/")[0]! : "")));
  return tops.size === 1 ? [...tops][0]! || null : null;
}

function checked(files: MapFile[], given: number): MapFile[] {
  if (given && !files.length) throw new Error("This folder has no files.");
  return files;
}

async function filesOf(entry: FileSystemEntry, above: string): Promise<MapFile[]> {
  if (isHidden(entry.name)) return [];
  const path = above + entry.name;
  if (entry.isFile) {
    const file = await new Promise<File>((found, failed) => (entry as FileSystemFileEntry).file(found, failed));
    return [{ path, file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const found: MapFile[] = [];
  for (;;) {
    // a browser gives about a hundred at a time
    const some = await new Promise<FileSystemEntry[]>((read, failed) => reader.readEntries(read, failed));
    if (!some.length) return found;
    for (const one of some) found.push(...(await filesOf(one, `${path}/`)));
  }
}

function isHidden(name: string): boolean {
  return name.startsWith(".");
}
