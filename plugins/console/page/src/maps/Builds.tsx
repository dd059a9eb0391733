// Builds under way, with their stages as they come, and the last that failed or were not activated.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { lastBuilds } from "../api/builds";
import type { Schemas } from "../api/client";
import { ErrorText } from "../ui/ErrorText";
import { BuildRow } from "./BuildRow";
import { EarlierBuilds } from "./EarlierBuilds";
import { type ActiveMap, hasFailed, hidden, isGoing, isHeldBack } from "./buildRecords";

type Build = Schemas["Build"];
const LOOK_MS = 3000;
const READ = 20;
const SHOWN = 10;

export interface BuildsProps {
  map?: string; // alone; undefined: of all
  maps: ActiveMap[]; // with their active versions
  done: () => void;
  again: (map: string) => void; // begins another build of the map
}

export function Builds({ map, maps, done, again }: BuildsProps) {
  const builds = useSignal<Build[]>([]);
  const problem = useSignal<unknown>(null);
  useEffect(() => {
    let going = true;
    const look = async () => {
      try {
        const found = (await lastBuilds(READ, map)).builds;
        const under = builds.value.filter(isGoing).map((one) => one.build_id);
        builds.value = found;
        // its row is gone now, perhaps before the end came over its stream
        if (found.some((one) => one.state === "succeeded" && under.includes(one.build_id))) done();
        problem.value = null;
      } catch (error) {
        problem.value = error;
      }
      if (going) setTimeout(look, LOOK_MS);
    };
    void look();
    return () => {
      going = false;
    };
  }, [map]);
  const shown = builds.value.filter(
    (one) => !hidden.value.includes(one.build_id) && (isGoing(one) || hasFailed(one) || isHeldBack(one, maps)),
  );
  if (problem.value) return <ErrorText error={problem.value} />;
  if (!builds.value.length) return null;
  return (
    <section aria-label="Builds">
      {shown.length ? (
        <>
          <h2>Builds</h2>
          <ul class="builds">
            {shown.slice(0, SHOWN).map((one) => (
              <BuildRow
                key={one.build_id}
                build={one}
                builds={builds.value}
                isNamed={map === undefined}
                done={done}
                again={() => again(one.map_id)}
              />
            ))}
          </ul>
        </>
      ) : null}
      <EarlierBuilds builds={builds.value.filter((one) => !isGoing(one) && !shown.includes(one))} isNamed={map === undefined} />
    </section>
  );
}
