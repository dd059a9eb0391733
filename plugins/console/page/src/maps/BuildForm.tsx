// A new map, or a new version of one: its file, its sensor, and off it goes.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import type { Schemas } from "../api/client";
import { Dialog } from "../ui/Dialog";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";
import { BuildFiles } from "./BuildFiles";
import type { ActiveMap } from "./buildRecords";
import { folderOf, type MapFile } from "./files";
import { type SensorConfig, SensorFields } from "./SensorFields";
import { handIn } from "./handIn";

export interface BuildFormProps {
  named: string; // the map that gets a new version; "": a new map
  maps: ActiveMap[]; // those that are there
  close: () => void;
}

export function BuildForm({ named, maps, close }: BuildFormProps) {
  const name = useSignal(named);
  const isMeant = useSignal(false);
  const files = useSignal<MapFile[]>([]);
  const trajectory = useSignal<File | null>(null);
  const sensor = useSignal<SensorConfig>(null);
  const axis = useSignal<Schemas["BuildConfig"]["axis"]>("z-up");
  const job = useSignal<{ label: string; share: number } | null>(null);
  const problem = useSignal<unknown>(null);
  const stop = useRef<AbortController | null>(null);
  const replaced = maps.find((one) => one.map_id === name.value && one.active_version !== null);

  const take = async (given: () => MapFile[] | Promise<MapFile[]>) => {
    problem.value = null;
    try {
      const found = await given();
      if (!found.length) return;
      files.value = found;
      if (!name.value) name.value = freeId(folderOf(found) ?? (found.length > 1 ? "map" : found[0]!.path), maps);
    } catch (error) {
      problem.value = error;
    }
  };
  const build = async (event: Event) => {
    event.preventDefault();
    if (!sensor.value) return;
    problem.value = null;
    stop.current = new AbortController();
    const { signal } = stop.current;
    try {
      const config = { sensor: sensor.value, axis: axis.value };
      await handIn(name.value, files.value, trajectory.value, config, (label, share) => (job.value = { label, share }), signal);
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
        <BuildFiles files={files.value} take={take} />
        <label>
          Name of the map
          <input
            required
            pattern="[a-z0-9][a-z0-9_\-]{0,62}"
            title="a to z, 0 to 9, _ and -"
            value={name.value}
            onInput={(event) => {
              name.value = event.currentTarget.value;
              isMeant.value = false;
            }}
          />
        </label>
        {replaced ? (
          <div class="error" role="alert">
            <p>
              There is a map <strong>{replaced.map_id}</strong>. When this build has ended, its version takes the place of
              the active one, unless its self-test fails. All robots that ask this map are then answered by it.
            </p>
            <label class="check">
              <input
                type="checkbox"
                required
                checked={isMeant.value}
                onChange={(event) => (isMeant.value = event.currentTarget.checked)}
              />
              Replace the active version of {replaced.map_id}
            </label>
          </div>
        ) : null}
        <SensorFields sensor={sensor} />
        <label>
          Axis of the file that points up
          <select
            value={axis.value}
            onChange={(event) => (axis.value = event.currentTarget.value as Schemas["BuildConfig"]["axis"])}
          >
            <option value="z-up">z, as usual in robotics</option>
            <option value="y-up">y, as usual in graphics</option>
          </select>
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

/** A name that no map has yet: a file's name must not replace a map that robots use. */
function freeId(fileName: string, maps: ActiveMap[]): string {
  const wanted = fileName
    .toLowerCase()
    .replace(/\.[a-z0-9]+$/, "")
    .replace(/[^a-z0-9_-]+/g, "-")
    .replace(/^[-_]+/, "")
    .slice(0, 60);
  const isTaken = (id: string) => maps.some((one) => one.map_id === id);
  let free = wanted;
  for (let number = 2; isTaken(free); number++) free = `${wanted}-${number}`;
  return free;
}
