// A new map, or a new version of one: its file, its sensor, and off it goes.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { change, get, type Schemas } from "../api/client";
import { Dialog } from "../ui/Dialog";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";
import { size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { chosen, dropped, folderOf, type MapFile } from "./files";
import { SensorPicture } from "./SensorPicture";
import { upload } from "./upload";
import { zipped } from "./zip";

export function BuildForm({ close }: { close: () => void }) {
  const sensors = useLoaded((signal) => get<Schemas["Sensor"][]>("/sensors", {}, signal), []);
  const name = useSignal("");
  const files = useSignal<MapFile[]>([]);
  const trajectory = useSignal<File | null>(null);
  const sensor = useSignal("os1-64");
  const height = useSignal("");
  const job = useSignal<{ label: string; share: number } | null>(null);
  const problem = useSignal<unknown>(null);
  const stop = useRef<AbortController | null>(null);
  const preset = sensors.value?.find((one) => one.name === sensor.value);
  const bytes = files.value.reduce((sum, { file }) => sum + file.size, 0);

  const take = async (given: () => MapFile[] | Promise<MapFile[]>) => {
    problem.value = null;
    try {
      const found = await given();
      if (!found.length) return;
      files.value = found;
      if (!name.value) name.value = idOf(folderOf(found) ?? (found.length > 1 ? "map" : found[0]!.path));
    } catch (error) {
      problem.value = error;
    }
  };
  const build = async (event: Event) => {
    event.preventDefault();
    problem.value = null;
    stop.current = new AbortController();
    const { signal } = stop.current;
    const tell = (label: string) => (share: number) => (job.value = { label, share });
    try {
      tell("Reading")(0);
      const source = files.value.length === 1 ? files.value[0]!.file : await zipped(files.value, tell("Reading"), signal);
      const id = await upload(source, tell("Uploading"), signal);
      const poses = trajectory.value && (await upload(trajectory.value, () => {}, signal));
      const model = height.value ? { preset: sensor.value, mount_height_m: Number(height.value) } : sensor.value;
      await change("POST", "/maps", {
        json: {
          map_id: name.value,
          source: { upload: id },
          trajectory: poses ? { upload: poses } : null,
          config: { sensor: model },
        },
        headers: { "Idempotency-Key": `console-${id}` },
      });
      close();
    } catch (error) {
      if (!signal.aborted) problem.value = error;
      job.value = null;
    }
  };
  const cancel = () => {
    stop.current?.abort();
    close();
  };
  return (
    <Dialog title="Build a map" close={cancel}>
      <form onSubmit={build}>
        <Drop take={take}>
          {files.value.length
            ? `${titleOf(files.value)}, ${size(bytes)}`
            : "Drop a map here: a cloud, a mesh, or the folder of a SLAM package"}
        </Drop>
        <FolderChoice take={take} />
        <label>
          Name of the map
          <input
            required
            pattern="[a-z0-9][a-z0-9_\-]{0,62}"
            title="a to z, 0 to 9, _ and -"
            value={name.value}
            onInput={(event) => (name.value = event.currentTarget.value)}
          />
        </label>
        <label>
          Sensor of the robots
          <select value={sensor.value} onChange={(event) => (sensor.value = event.currentTarget.value)}>
            {(sensors.value ?? []).map((one) => (
              <option key={one.name}>{one.name}</option>
            ))}
          </select>
        </label>
        {preset ? <SensorPicture sensor={preset} /> : null}
        <label>
          Its height above the floor, metres
          <input
            type="number"
            step="any"
            min={0}
            max={100}
            placeholder={String(preset?.mount_height_m ?? "")}
            value={height.value}
            onInput={(event) => (height.value = event.currentTarget.value)}
          />
        </label>
        <label>
          Trajectory of the mapping run, if there is one: TUM, KITTI or CSV
          <input type="file" onChange={(event) => (trajectory.value = event.currentTarget.files?.[0] ?? null)} />
        </label>
        {job.value ? <Progress {...job.value} /> : null}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        <div class="row end">
          <button type="button" onClick={cancel}>
            Cancel
          </button>
          <button class="primary" disabled={!files.value.length || job.value !== null}>
            Build
          </button>
        </div>
      </form>
    </Dialog>
  );
}

type Take = (given: () => MapFile[] | Promise<MapFile[]>) => void;

function Drop({ take, children }: { take: Take; children: string }) {
  const over = useSignal(false);
  return (
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
      <span>{children}</span>
      <input
        type="file"
        multiple
        onChange={(event) => {
          const list = event.currentTarget.files;
          take(() => chosen(list));
        }}
      />
    </label>
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

function idOf(fileName: string): string {
  return fileName
    .toLowerCase()
    .replace(/\.[a-z0-9]+$/, "")
    .replace(/[^a-z0-9_-]+/g, "-")
    .replace(/^[-_]+/, "")
    .slice(0, 63);
}
