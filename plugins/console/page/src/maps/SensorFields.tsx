// The sensor of the robots: a preset, or a file that describes another one; and how high it is mounted.

import { type Signal, useSignal } from "@preact/signals";
import { sensorList } from "../api/builds";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { SensorPicture } from "./SensorPicture";

const OWN = "own";

/** As the build's config has it: a name, or a mapping. Null: not chosen yet. */
export type SensorConfig = string | Record<string, unknown> | null;

export function SensorFields({ sensor }: { sensor: Signal<SensorConfig> }) {
  const presets = useLoaded(sensorList, []);
  const choice = useSignal("");
  const own = useSignal<Record<string, unknown> | null>(null);
  const height = useSignal("");
  const problem = useSignal<unknown>(null);
  const preset = presets.value?.find((one) => one.name === choice.value);
  const tell = () => {
    const mount = height.value ? { mount_height_m: Number(height.value) } : {};
    if (choice.value === OWN) sensor.value = own.value && { ...own.value, ...mount };
    else if (!choice.value) sensor.value = null;
    else sensor.value = height.value ? { preset: choice.value, ...mount } : choice.value;
  };
  const read = async (file: File | undefined) => {
    problem.value = null;
    own.value = null;
    try {
      if (file) own.value = await (await import("./sensorFile")).sensorOf(file);
    } catch (error) {
      problem.value = error;
    }
    tell();
  };
  return (
    <>
      <label>
        Sensor of the robots
        <select
          required
          value={choice.value}
          onChange={(event) => {
            choice.value = event.currentTarget.value;
            tell();
          }}
        >
          <option value="">Choose the sensor</option>
          {(presets.value ?? []).map((one) => (
            <option key={one.name}>{one.name}</option>
          ))}
          <option value={OWN}>another one: a YAML or JSON file</option>
        </select>
      </label>
      {presets.error ? <ErrorText error={presets.error} again={presets.again} /> : null}
      {choice.value === OWN ? (
        <label>
          File of the sensor, as <code>firstfix sensor</code> writes it
          <input
            type="file"
            required
            accept=".yaml,.yml,.json"
            onChange={(event) => void read(event.currentTarget.files?.[0])}
          />
        </label>
      ) : null}
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {preset ? <SensorPicture sensor={preset} /> : null}
      <label>
        Its height above the floor, metres{preset ? `: ${preset.mount_height_m} if you give none` : ""}
        <input
          type="number"
          step="any"
          min={0}
          max={100}
          value={height.value}
          onInput={(event) => {
            height.value = event.currentTarget.value;
            tell();
          }}
        />
      </label>
    </>
  );
}
