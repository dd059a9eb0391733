// All maps that the caller sees: how good they are, how they do, what needs a person, and what can be done with them.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import { mapPage } from "../api/maps";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { usePolled } from "../ui/usePolled";
import { useAnswerCounts } from "./answerCounts";
import { BuildForm } from "./BuildForm";
import { Builds } from "./Builds";
import { DeleteMap } from "./DeleteMap";
import type { Manifest } from "./manifest";
import { MapRow } from "./MapRow";
import { Needs } from "./Needs";

const LOOK_MS = 5000;
const PICTURES = 30; // of the first maps: each is a request

export function MapList() {
  const maps = usePolled(mapPage, [], LOOK_MS);
  const counts = useAnswerCounts();
  const manifests = useSignal(new Map<string, Manifest>());
  const building = useSignal<string | null>(null); // the map that gets a new version; "": a new map
  const doomed = useSignal<string | null>(null);
  if (maps.error && !maps.value) return <ErrorText error={maps.error} again={maps.again} />;
  if (!maps.value) return <p role="status">Reading the maps …</p>;
  return (
    <main class="page">
      <header class="row">
        <h1>Maps</h1>
        {mayBuild.value ? (
          <button class="primary" onClick={() => (building.value = "")}>
            Build a map
          </button>
        ) : null}
      </header>
      {maps.error ? <ErrorText error={maps.error} again={maps.again} /> : null}
      <Needs maps={maps.value.maps} manifests={manifests.value} counts={counts} />
      {building.value !== null ? (
        <BuildForm named={building.value} maps={maps.value.maps} close={() => (building.value = null)} />
      ) : null}
      {mayBuild.value ? <Builds maps={maps.value.maps} done={maps.again} again={(map) => (building.value = map)} /> : null}
      {maps.value.maps.length ? (
        <table class="cards">
          <thead>
            <tr>
              <th>Map</th>
              <th class="number">Localized in its self-test</th>
              <th class="number">Sure and wrong</th>
              <th class="number">Best place within 0.2 m</th>
              {mayBuild.value ? (
                <>
                  <th>Asked in the last hour</th>
                  <th>in the last day</th>
                </>
              ) : null}
              <th>Active version</th>
              <th class="number">Size</th>
              <th>
                <span class="unseen">Actions</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {maps.value.maps.map((one, i) => (
              <MapRow
                key={`${one.map_id} ${one.active_version}`}
                one={one}
                counts={counts.get(one.map_id)}
                hasPicture={i < PICTURES}
                read={(manifest) => (manifests.value = new Map(manifests.value).set(one.map_id, manifest))}
                remove={() => (doomed.value = one.map_id)}
              />
            ))}
          </tbody>
        </table>
      ) : (
        <Empty title="No map yet">
          <p>
            {mayBuild.value
              ? "Build one from a cloud, a mesh or a SLAM folder: PLY, PCD, LAS, LAZ, E57, OBJ, STL or a zip."
              : "Somebody whose key has the scope build has to build one."}
          </p>
        </Empty>
      )}
      {doomed.value ? (
        <DeleteMap
          map={doomed.value}
          close={() => (doomed.value = null)}
          done={maps.again}
        />
      ) : null}
    </main>
  );
}
