// Scans to try a map with at once: simulated from its own points, at the pose by hand or somewhere in the map.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Asked } from "./scanFile";
import { simulatedScan } from "./simulated";

export interface ExamplesProps {
  map: string;
  version: string;
  spot: readonly number[] | null; // that was clicked
  take: (asked: Asked) => void;
  problem: Signal<unknown>;
}

export function Examples({ map, version, spot, take, problem }: ExamplesProps) {
  const isWorking = useSignal(false);
  const running = useRef<AbortController | null>(null);
  useEffect(() => () => running.current?.abort(), [map, version]);
  const simulate = async (at: readonly number[] | null) => {
    running.current?.abort();
    const stop = new AbortController();
    running.current = stop;
    isWorking.value = true;
    problem.value = null;
    try {
      const found = await simulatedScan(map, version, at, stop.signal);
      if (!stop.signal.aborted) take(found);
    } catch (error) {
      if (!stop.signal.aborted) problem.value = error;
    } finally {
      if (running.current === stop) isWorking.value = false;
    }
  };
  return (
    <section class="examples" aria-label="Example scans">
      <div class="row">
        <button disabled={!version} onClick={() => simulate(null)}>
          Try an example scan
        </button>
        {spot ? <button onClick={() => simulate(spot)}>Simulate one at the clicked spot</button> : null}
      </div>
      <small>
        {isWorking.value ? "Simulating …" : "Simulated in the browser from the map's points. Click the map to choose a spot."}
      </small>
    </section>
  );
}
