// A new map, or a new version of one: its file, its sensor, and off it goes.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { change, get, type Schemas } from "../api/client";
import { Dialog } from "../ui/Dialog";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";
import { size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { SensorPicture } from "./SensorPicture";
import { upload } from "./upload";
import { zipped } from "./zip";

export function BuildForm({ close }: { close: () => void }) {
  const sensors = useLoaded((signal) => get<Schemas["Sensor"][]>("/sensors", {}, signal), []);
  const name = useSignal("");
  const files = useSignal<File[]>([]);
  const trajectory = useSignal<File | null>(null);
  const sensor = useSignal("os1-64");
  const height = useSignal("");
  const share = useSignal<number | null>(null);
  const problem = useSignal<unknown>(null);
  const stop = useRef<AbortController | null>(null);
  const chosen = sensors.value?.find((one) => one.name === sensor.value);
  const bytes = files.value.reduce((sum, file) => sum + file.size, 0);

  const take = (given: File[]) => {
    files.value = given;
    if (!name.value && given[0]) name.value = idOf(folderOf(given) ?? given[0].name);
  };
  const build = async (event: Event) => {
    event.preventDefault();
    problem.value = null;
    stop.current = new AbortController();
    try {
      const source = files.value.length === 1 ? files.value[0]! : await zipped(files.value);
      share.value = 0;
      const id = await upload(source, (done) => (share.value = done), stop.current.signal);
      const poses = trajectory.value && (await upload(trajectory.value, () => {}, stop.current.signal));
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
      if (!stop.current.signal.aborted) problem.value = error;
      share.value = null;
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
            ? `${folderOf(files.value) ?? files.value[0]!.name}, ${size(bytes)}`
            : "Drop a map here: a cloud, a mesh, or the files of a SLAM folder"}
        </Drop>
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
        {chosen ? <SensorPicture sensor={chosen} /> : null}
        <label>
          Its height above the floor, metres
          <input
            type="number"
            step="any"
            min={0}
            max={100}
            placeholder={String(chosen?.mount_height_m ?? "")}
            value={height.value}
            onInput={(event) => (height.value = event.currentTarget.value)}
          />
        </label>
        <label>
          Trajectory of the mapping run, if there is one: TUM, KITTI or CSV
          <input type="file" onChange={(event) => (trajectory.value = event.currentTarget.files?.[0] ?? null)} />
        </label>
        {share.value === null ? null : <Progress label="Uploading" share={share.value} />}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        <div class="row end">
          <button type="button" onClick={cancel}>
            Cancel
          </button>
          <button class="primary" disabled={!files.value.length || share.value !== null}>
            Build
          </button>
        </div>
      </form>
    </Dialog>
  );
}

function Drop({ take, children }: { take: (files: File[]) => void; children: string }) {
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
        take([...(event.dataTransfer?.files ?? [])]);
      }}
    >
      <span>{children}</span>
      <input type="file" multiple onChange={(event) => take([...(event.currentTarget.files ?? [])])} />
    </label>
  );
}

function folderOf(files: File[]): string | null {
  return files.length > 1 ? (files[0]!.webkitRelativePath.split("/")[0] || "map") : null;
}

function idOf(fileName: string): string {
  return fileName
    .toLowerCase()
    .replace(/\.[a-z0-9]+$/, "")
    .replace(/[^a-z0-9_-]+/g, "-")
    .replace(/^[-_]+/, "")
    .slice(0, 63);
}
