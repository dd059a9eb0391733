// One version in the list: what it is, how good it is, and what can be done with it.

import { mayAdminister, mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { versionDetails } from "../api/maps";
import { manifestOf } from "../maps/manifest";
import { patchAddress } from "../patch/PatchLink";
import { link } from "../router";
import { chance, percent, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { When } from "../ui/When";
import type { Change } from "./changeOf";
import { MadeOf } from "./MadeOf";

type Version = Schemas["VersionSummary"];

export interface VersionRowProps {
  map: string;
  one: Version;
  isCompared: boolean;
  compare: (() => void) | null; // null: there is none to compare it with
  ask: (change: Change) => void;
}

export function VersionRow({ map, one, isCompared, compare, ask }: VersionRowProps) {
  const details = useLoaded((signal) => versionDetails(map, one.version, signal), [map, one.version]);
  const { source } = manifestOf(details.value);
  const { localized, false_accepts: wrong, sensor, threshold } = one.summary;
  return (
    <tr>
      {compare ? (
        <td data-name="Compare">
          <input type="checkbox" aria-label={`Compare ${short(one.version)}`} checked={isCompared} onChange={compare} />
        </td>
      ) : null}
      <th scope="row">
        <a href={link(["maps", map], { version: one.version })}>
          <code>{short(one.version)}</code>
        </a>
      </th>
      <td data-name="Made of">
        <MadeOf {...one.provenance} />
      </td>
      <td class="number" data-name="Localized in its self-test">
        {typeof localized === "number" ? <strong>{percent(localized)}</strong> : ""}
      </td>
      <td class="number" data-name="Sure and wrong">
        {wrong ?? ""}
      </td>
      <td class="number" data-name="Threshold">
        {threshold ? chance(threshold.min_probability, 0) : ""}
      </td>
      <td class="nowrap" data-name="Sensor">{sensor ?? ""}</td>
      <td data-name="Published">
        <When iso={one.published_time} />
      </td>
      <td data-name="State">
        {one.active ? <span class="tag on">active</span> : null}
        {one.provisional ? <span class="tag">provisional</span> : null}
        {source?.patch ? <a href={patchAddress(map, one.version)}>Before and after</a> : null}
      </td>
      <td class="actions">
        {mayBuild.value && !one.active ? (
          <button onClick={() => ask({ kind: "activate", version: one.version })}>Activate</button>
        ) : null}
        {mayAdminister.value && !one.active ? (
          <button onClick={() => ask({ kind: "retire", version: one.version })}>Retire</button>
        ) : null}
      </td>
    </tr>
  );
}
