// Choosing the files of a map: dropped, or by the browser's dialogs.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { size } from "../ui/text";
import { chosen, dropped, folderOf, type MapFile } from "./files";

export type Take = (given: () => MapFile[] | Promise<MapFile[]>) => void;

export function BuildFiles({ files, take }: { files: MapFile[]; take: Take }) {
  const over = useSignal(false);
  const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
  return (
    <>
      <label
        class={over.value ? "drop over" : "drop"}
        onDragOver={(event) => {
          event.preventDefault();
          over.value = true;
        }}
        onDragLeave={() => (over.value = false)}
        onDrop={(event) => {
          event.preventDefault();
          over.value = false;
          const data = event.dataTransfer;
          if (data) take(() => dropped(data));
        }}
      >
        <span>
          {files.length
            ? `${titleOf(files)}, ${size(bytes)}`
            : "Drop a map here: a cloud, a mesh, or the folder of a SLAM package"}
        </span>
        <input
          type="file"
          multiple
          onChange={(event) => {
            const list = event.currentTarget.files;
            take(() => chosen(list));
          }}
        />
      </label>
      <FolderChoice take={take} />
    </>
  );
}

/** The browser's dialog chooses either files or a folder, so a folder has its own. */
function FolderChoice({ take }: { take: Take }) {
  const input = useRef<HTMLInputElement | null>(null);
  return (
    <div class="row">
      <button type="button" onClick={() => input.current?.click()}>
        Choose a folder
      </button>
      <input
        ref={(element) => {
          input.current = element;
          if (element) element.webkitdirectory = true;
        }}
        hidden
        type="file"
        onChange={(event) => {
          const list = event.currentTarget.files;
          take(() => chosen(list));
        }}
      />
    </div>
  );
}

function titleOf(files: MapFile[]): string {
  if (files.length === 1) return files[0]!.path;
  return `${folderOf(files) ?? "Several files"}: ${files.length} files`;
}
