// All maps that the caller sees, and what can be done with them.

import { useSignal } from "@preact/signals";
import { mayAdminister, mayBuild } from "../access/session";
import { get, type Schemas } from "../api/client";
import { link } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { age, count, percent, short, size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { BuildForm } from "./BuildForm";
import { Builds } from "./Builds";
import { DeleteMap } from "./DeleteMap";

interface Manifest {
  counts?: Record<string, number>;
  files?: Record<string, { bytes: number }>;
  self_test?: { success?: Record<string, number> };
  provisional?: boolean;
}

export function MapList() {
  const maps = useLoaded((signal) => get<Schemas["MapPage"]>("/maps", { limit: 1000 }, signal), []);
  const building = useSignal(false);
  const doomed = useSignal<string | null>(null);
  if (maps.error) return <ErrorText error={maps.error} again={maps.again} />;
  if (!maps.value) return <p role="status">Reading the maps …</p>;
  return (
    <main class="page">
      <header class="row">
        <h1>Maps</h1>
        {mayBuild.value ? (
          <button class="primary" onClick={() => (building.value = true)}>
            Build a map
          </button>
        ) : null}
      </header>
      {building.value ? <BuildForm close={() => (building.value = false)} /> : null}
      {mayBuild.value ? <Builds done={maps.again} /> : null}
      {maps.value.maps.length ? (
        <table>
          <thead>
            <tr>
              <th>Map</th>
              <th>Active version</th>
              <th>Published</th>
              <th class="number">Templates</th>
              <th class="number">Within 0.2 m</th>
              <th class="number">Size</th>
              <th />
            </tr>
          </thead>
          <tbody>
            {maps.value.maps.map((one) => (
              <Row
                key={one.map_id + one.active_version}
                map={one.map_id}
                version={one.active_version}
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
          done={() => {
            doomed.value = null;
            maps.again();
          }}
        />
      ) : null}
    </main>
  );
}

function Row({ map, version, remove }: { map: string; version: string | null; remove: () => void }) {
  const versions = useLoaded(
    (signal) => get<Schemas["VersionPage"]>(`/maps/${map}/versions`, { limit: 100 }, signal),
    [map, version],
  );
  const details = useLoaded((signal) => get<Schemas["MapDetails"]>(`/maps/${map}`, {}, signal), [map, version]);
  const manifest = (details.value?.manifest ?? {}) as Manifest;
  const published = versions.value?.versions.find((one) => one.active)?.published_time;
  const bytes = Object.values(manifest.files ?? {}).reduce((sum, file) => sum + file.bytes, 0);
  const success = manifest.self_test?.success?.["0.2m"];
  return (
    <tr>
      <th scope="row">
        <a href={link(["maps", map])}>{map}</a>
      </th>
      <td>
        {version ? <code title={version}>{short(version)}</code> : "none"}{" "}
        {manifest.provisional ? <span class="tag">provisional</span> : null}
        {details.error ? <ErrorText error={details.error} /> : null}
      </td>
      <td>{published ? age(published) : ""}</td>
      <td class="number">{manifest.counts?.templates === undefined ? "" : count(manifest.counts.templates)}</td>
      <td class="number">{success === undefined ? "" : percent(success)}</td>
      <td class="number">{bytes ? size(bytes) : ""}</td>
      <td class="actions">
        <a href={link(["maps", map, "try"])}>Try a scan</a>
        <a href={link(["maps", map, "versions"])}>Versions</a>
        {mayAdminister.value ? (
          <button onClick={remove} aria-label={`Delete map ${map}`}>
            Delete
          </button>
        ) : null}
      </td>
    </tr>
  );
}
