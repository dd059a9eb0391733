// One map in the list: how it looks, how good it is, how it does, and what can be done with it.

import { mayAdminister, mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { link } from "../router";
import { count, percent, short } from "../ui/text";
import { When } from "../ui/When";
import { countedTexts, type MapCounts } from "./answerCounts";
import { Thumbnail } from "./Thumbnail";

export interface MapRowProps {
  one: Schemas["MapSummary"];
  counts: MapCounts | undefined;
  hasPicture: boolean;
  remove: () => void;
}

export function MapRow({ one, counts, hasPicture, remove }: MapRowProps) {
  const { map_id: map, active_version: version, published_time: published, summary } = one;
  const { localized, false_accepts: wrong, size_m, templates } = summary;
  return (
    <tr>
      <th scope="row">
        <a href={link(["maps", map])}>
          {hasPicture ? <Thumbnail map={map} version={one.provisional ? null : version} /> : null}
          {map}
        </a>
      </th>
      <td class="number" data-name="Localized in its self-test">
        <strong>{typeof localized === "number" ? percent(localized) : ""}</strong>
      </td>
      <td class="number" data-name="Sure and wrong">
        {wrong ?? ""}
      </td>
      {mayBuild.value ? (
        <>
          <td data-name="Asked in the last hour">{counts ? <Counted answers={counts.hour} /> : "none"}</td>
          <td data-name="in the last day">
            {counts ? <Counted answers={counts.day} /> : "none"}
            {counts ? <small class="last">last {<When iso={counts.last_time} />}</small> : null}
          </td>
        </>
      ) : null}
      <td data-name="Active version">
        {version ? <code title={version}>{short(version)}</code> : "none"} {published ? <When iso={published} /> : null}
        {one.provisional ? <span class="tag">provisional</span> : null}
      </td>
      <td class="nowrap" data-name="Size">
        {size_m ? `${size_m.map((m) => m.toFixed(0)).join(" × ")} m` : ""}
        {typeof templates === "number" ? <small class="last">{count(templates)} templates</small> : null}
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

function Counted({ answers }: { answers: Schemas["CountedAnswers"] }) {
  const [answered, localized] = countedTexts(answers);
  return (
    <>
      {answered} <small class="last">{localized}</small>
    </>
  );
}
