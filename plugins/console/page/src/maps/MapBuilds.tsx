import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import { BuildForm } from "./BuildForm";
import { Builds } from "./Builds";
import type { ActiveMap } from "./buildRecords";

export interface MapBuildsProps {
  map: string;
  active: string | null; // its active version
  done: () => void;
}

/** The builds of one map, on its own page. */
export function MapBuilds({ map, active, done }: MapBuildsProps) {
  const isTriedAgain = useSignal(false);
  if (!mayBuild.value) return null;
  const maps: ActiveMap[] = active ? [{ map_id: map, active_version: active }] : [];
  return (
    <>
      <Builds map={map} maps={maps} done={done} again={() => (isTriedAgain.value = true)} />
      {isTriedAgain.value ? <BuildForm named={map} maps={maps} close={() => (isTriedAgain.value = false)} /> : null}
    </>
  );
}
