import { mayAdminister } from "../access/session";
import { link } from "../router";
import { whyOf } from "../scan/why";
import { age, chance, size } from "../ui/text";
import { Verdict } from "../ui/Verdict";
import { answerOf, mapOf, type Sample } from "./place";

export interface SampleTableProps {
  samples: Sample[];
  remove: (sample: Sample) => void;
  point: (sampleId: string) => void; // "": at none
}

/** Kept queries, one a row. */
export function SampleTable({ samples, remove, point }: SampleTableProps) {
  return (
    <table class="cards">
      <thead>
        <tr>
          <th>When</th>
          <th>Map</th>
          <th>Verdict</th>
          <th>Why</th>
          <th class="number">Probability</th>
          <th class="number">Size</th>
          <th>Truth</th>
          <th>
            <span class="unseen">Actions</span>
          </th>
        </tr>
      </thead>
      <tbody>
        {samples.map((one) => (
          <tr key={one.sample_id} onPointerEnter={() => point(one.sample_id)} onPointerLeave={() => point("")}>
            <td data-name="When" title={one.time}>{age(one.time)}</td>
            <td data-name="Map">{one.map_id || "any"}</td>
            <td data-name="Verdict">
              <Verdict verdict={answerOf(one).verdict} />
            </td>
            <td data-name="Why">{whyOf(answerOf(one), leastAsked(one)).join(" ")}</td>
            <td class="number" data-name="Probability">{chance(answerOf(one).probability)}</td>
            <td class="number" data-name="Size">{size(one.body_bytes)}</td>
            <td data-name="Truth">{one.truth ? (one.truth.T_map_sensor ? "known" : "not in the map") : ""}</td>
            <td class="actions">
              {mapOf(one) ? (
                <a href={link(["maps", mapOf(one), "try"], { sample: one.sample_id })} onFocus={() => point(one.sample_id)}>
                  Look
                </a>
              ) : null}
              {mayAdminister.value ? <button onClick={() => remove(one)}>Remove</button> : null}
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** What the query asked for itself; null: as the map had it then. */
function leastAsked({ options }: Sample): number | null {
  return Number(options.min_probability) || null;
}
