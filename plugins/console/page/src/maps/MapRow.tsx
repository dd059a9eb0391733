// One map in the list: how it looks, how good it is, how it does, and what can be done with it.

import { useEffect } from "preact/hooks";
import { mayAdminister, mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { mapDetails, versionPage } from "../api/maps";
import { link } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { age, count, percent, short, size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { countedText, type MapCounts } from "./answerCounts";
import { bytesOf, type Manifest, manifestOf } from "./manifest";
import { Preview } from "./Preview";

const NEWEST = 100; // versions, among which the active one is looked for

export interface MapRowProps {
  one: Schemas["MapSummary"];
  counts: MapCounts | undefined;
  hasPicture: boolean;
  read: (manifest: Manifest) => void;
  remove: () => void;
}

export function MapRow({ one, counts, hasPicture, read, remove }: MapRowProps) {
  const { map_id: map, active_version: version } = one;
  const versions = useLoaded((signal) => versionPage(map, signal, NEWEST), [map, version]);
  const details = useLoaded((signal) => mapDetails(map, signal), [map, version]);
  useEffect(() => {
    if (details.value) read(manifestOf(details.value));
  }, [details.value]);
  const manifest = manifestOf(details.value);
  const published = versions.value?.versions.find((found) => found.active)?.published_time;
  const bytes = bytesOf(manifest);
  const { localized, false_accepts: wrong, success } = manifest.self_test ?? {};
  const share = (value: number | undefined) => (value === undefined ? "" : percent(value));
  return (
    <tr>
      <th scope="row">
        <a href={link(["maps", map])}>{map}</a>
        {version && hasPicture ? (
          <div class="preview">
            {manifest.files?.["preview.png"] ? <Preview map={map} version={version} /> : null}
          </div>
        ) : null}
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
      {mayBuild.value ? (
        <>
          <td data-name="Asked in the last hour">{counts ? countedText(counts.hour) : "none"}</td>
          <td data-name="in the last day">
            {counts ? `${countedText(counts.day)}, the last ${age(counts.last_time)}` : "none"}
          </td>
        </>
      ) : null}
      <td data-name="Active version">
        {version ? <code title={version}>{short(version)}</code> : "none"}{" "}
        {manifest.provisional ? <span class="tag">provisional</span> : null}
        {details.error ? <ErrorText error={details.error} /> : null}
        {published ? <small> {age(published)}</small> : null}
      </td>
      <td class="number" data-name="Size">
        {manifest.counts?.templates === undefined ? "" : `${count(manifest.counts.templates)} templates, `}
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
