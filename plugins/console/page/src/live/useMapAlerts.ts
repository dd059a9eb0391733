// Looks now and then for what about a map needs a person.

import { mayBuild } from "../access/session";
import { lastBuilds } from "../api/builds";
import { mapDetails } from "../api/maps";
import { recordedPage } from "../api/scans";
import { hidden } from "../maps/buildRecords";
import { usePolled } from "../ui/usePolled";
import { answerAlerts, buildAlerts, patchAlerts, waitingPatch } from "./mapAlerts";
import type { Alert } from "./robotsOf";

const LOOK_MS = 15_000; // a person judges, a build ends: nobody needs it sooner
const LAST_QUERIES = 200;
const LAST_BUILDS = 20;

/** null: not known yet. */
export function useMapAlerts(map: string, now_s: number): { alerts: Alert[] | null; error: unknown } {
  const isAsked = map !== "" && mayBuild.value;
  const { value, error } = usePolled(
    async (signal) => {
      if (!isAsked) return null;
      const [page, builds] = await Promise.all([recordedPage({ map_id: map, limit: LAST_QUERIES }, signal), lastBuilds(LAST_BUILDS, map)]);
      const patch = waitingPatch(builds.builds, hidden.value);
      const active = patch && (await mapDetails(map, signal)).active_version;
      return { map, queries: page.queries, builds: builds.builds, patch, active };
    },
    [map, isAsked],
    LOOK_MS,
  );
  if (value?.map !== map) return { alerts: null, error };
  const ofBuilds = [...buildAlerts(value.builds, hidden.value, now_s), ...patchAlerts(value.patch, value.active, now_s)];
  return { alerts: [...answerAlerts(value.queries, map, now_s), ...ofBuilds], error };
}
