// The self-test's grid of the version that is shown: loaded once, when a layer first needs it.

import { useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useRef } from "preact/hooks";
import { type Cloud, mark, mapPositions } from "./cloud";
import { spotGrid, type SpotGrid } from "./spots";

export function useSpotGrid(
  map: string,
  version: string,
  cloud: RefObject<Cloud | null>,
): { value: SpotGrid | null; load: () => Promise<SpotGrid> } {
  const found = useSignal<{ version: string; grid: SpotGrid } | null>(null);
  const loading = useRef<{ version: string; grid: Promise<SpotGrid> } | null>(null);
  const load = () => {
    if (loading.current?.version === version) return loading.current.grid;
    const grid = read(map, version, cloud.current);
    loading.current = { version, grid };
    grid.then(
      (value) => (found.value = { version, grid: value }),
      () => (loading.current = null), // the next look tries again
    );
    return grid;
  };
  return { value: found.value?.version === version ? found.value.grid : null, load };
}

async function read(map: string, version: string, cloud: Cloud | null): Promise<SpotGrid> {
  const templates = cloud ? mapPositions(cloud, await mark(cloud, "templates")) : [];
  return spotGrid(map, version, templates);
}
