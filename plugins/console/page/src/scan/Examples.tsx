// Scans to try a map with at once: simulated from its own points, at the pose by hand or somewhere in the map.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { route } from "../router";
import type { Asked } from "./asked";
import { simulatedScan } from "./simulated";
import { spotOf, spotText } from "./tryState";

export interface ExamplesProps {
  map: string;
  version: string;
  clicked: readonly number[] | null; // spot of the map
  asked: Asked | null; // the scan that is tried now
  take: (asked: Asked) => void;
  problem: Signal<unknown>;
}

export function Examples({ map, version, clicked, asked, take, problem }: ExamplesProps) {
  const isWorking = useSignal(false);
  const running = useRef<AbortController | null>(null);
  useEffect(() => () => running.current?.abort(), [map, version, asked]); // a scan that came meanwhile stays
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
  useEffect(() => {
    // a link to a simulated scan: it is simulated again
    const { query } = route.value;
    const spot = query.has("recorded") ? null : spotOf(query.get("spot"));
    if (version && spot && spotText(spot) !== (asked?.spot && spotText(asked.spot))) void simulate(spot);
  }, [route.value, version]);
  return (
    <section class="examples" aria-label="Example scans">
      <div class="row">
        <button disabled={!version} onClick={() => simulate(null)}>
          Try an example scan
        </button>
        {clicked ? <button onClick={() => simulate(clicked)}>Simulate one at the clicked spot</button> : null}
      </div>
      <small>
        {isWorking.value ? "Simulating …" : "Simulated in the browser from the map's points. Click the map to choose a spot."}
      </small>
    </section>
  );
}
