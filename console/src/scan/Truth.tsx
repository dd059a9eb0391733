// Where a kept scan was really taken, as whoever looks at it says: tests of later versions use it.

import { useSignal } from "@preact/signals";
import { change } from "../api/client";
import type { Pose } from "../map3d/marks";
import { ErrorText } from "../ui/ErrorText";

export function Truth({ sample, map, pose }: { sample: string; map: string; pose: Pose | null }) {
  const told = useSignal("");
  const problem = useSignal<unknown>(null);
  const tell = async (T_map_sensor: Pose | null, text: string) => {
    try {
      await change("PUT", `/samples/${sample}/truth`, { json: { map_id: map, T_map_sensor } });
      told.value = text;
    } catch (error) {
      problem.value = error;
    }
  };
  return (
    <section>
      <h3>Where was it really taken?</h3>
      <div class="row">
        <button disabled={!pose} onClick={() => tell(pose, "Noted: at this place")}>
          At this place
        </button>
        <button onClick={() => tell(null, "Noted: not in this map")}>Not in this map</button>
        <span role="status">{told.value}</span>
      </div>
      {problem.value ? <ErrorText error={problem.value} /> : null}
    </section>
  );
}
