// Where a recorded scan was really taken, as whoever looks at it says: tests of later versions use it.

import { useSignal } from "@preact/signals";
import { tellTruth } from "../api/scans";
import type { Pose } from "../map3d/marks";
import { ErrorText } from "../ui/ErrorText";

export interface TruthProps {
  queryId: string;
  map: string;
  place: Pose | null; // of the hypothesis that is shown
  hand: Pose | null;
}

export function Truth({ queryId, map, place, hand }: TruthProps) {
  const told = useSignal("");
  const problem = useSignal<unknown>(null);
  const tell = async (T_map_sensor: Pose | null, text: string) => {
    problem.value = null;
    try {
      await tellTruth(queryId, map, T_map_sensor);
      told.value = text;
    } catch (error) {
      problem.value = error;
    }
  };
  return (
    <section aria-label="Truth">
      <h3>Where was it really taken?</h3>
      <div class="row">
        <button disabled={!place} onClick={() => tell(place, "Noted: at the place shown")}>
          At the place shown
        </button>
        <button disabled={!hand} onClick={() => tell(hand, "Noted: at the pose by hand")}>
          At the pose by hand
        </button>
        <button onClick={() => tell(null, "Noted: not in this map")}>Not in this map</button>
        <span role="status">{told.value}</span>
      </div>
      {problem.value ? <ErrorText error={problem.value} /> : null}
    </section>
  );
}
