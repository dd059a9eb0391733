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
import { bytesOf, manifestOf } from "./manifest";

export function MapList() {
  const maps = useLoaded((signal) => get<Schemas["MapPage"]>("/maps", { limit: 1000 }, signal), []);
  const building = useSignal<string | null>(null); // the map that gets a new version; "": a new map
  const doomed = useSignal<string | null>(null);
  if (maps.error) return <ErrorText error={maps.error} again={maps.again} />;
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
      {building.value !== null ? (
        <BuildForm named={building.value} maps={maps.value.maps} close={() => (building.value = null)} />
      ) : null}
      {mayBuild.value ? <Builds done={maps.again} again={(map) => (building.value = map)} /> : null}
      {maps.value.maps.length ? (
        <table class="cards">
          <thead>
            <tr>
              <th>Map</th>
              <th class="number">Localized in its self-test</th>
              <th class="number">Sure and wrong</th>
              <th class="number">Best place within 0.2 m</th>
              <th>Active version</th>
              <th>Published</th>
              <th class="number">Templates</th>
              <th class="number">Size</th>
              <th>
                <span class="unseen">Actions</span>
              </th>
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
          done={maps.again}
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
  const manifest = manifestOf(details.value);
  const published = versions.value?.versions.find((one) => one.active)?.published_time;
  const bytes = bytesOf(manifest);
  const { localized, false_accepts: wrong, success } = manifest.self_test ?? {};
  const share = (value: number | undefined) => (value === undefined ? "" : percent(value));
  return (
    <tr>
      <th scope="row">
        <a href={link(["maps", map])}>{map}</a>
      </th>
      <td class="number" data-name="Localized in its self-test">
        <strong>{share(localized)}</strong>
      </td>
      <td class="number" data-name="Sure and wrong">
        {wrong ?? ""}
      </td>
      <td class="number" data-name="Best place within 0.2 m">
        {share(success?.["0.2m"])}
      </td>
      <td data-name="Active version">
        {version ? <code title={version}>{short(version)}</code> : "none"}{" "}
        {manifest.provisional ? <span class="tag">provisional</span> : null}
        {details.error ? <ErrorText error={details.error} /> : null}
      </td>
      <td data-name="Published">{published ? age(published) : ""}</td>
      <td class="number" data-name="Templates">
        {manifest.counts?.templates === undefined ? "" : count(manifest.counts.templates)}
      </td>
      <td class="number" data-name="Size">
        {bytes ? size(bytes) : ""}
      </td>
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
