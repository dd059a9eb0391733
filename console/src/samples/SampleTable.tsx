import { mayAdminister } from "../access/session";
import { link } from "../router";
import { age, percent, reason, size } from "../ui/text";
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
    <table>
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
            <td title={one.time}>{age(one.time)}</td>
            <td>{one.map_id || "any"}</td>
            <td>
              <Verdict verdict={answerOf(one).verdict} />
            </td>
            <td>{answerOf(one).reasons.map(reason).join(" ")}</td>
            <td class="number">{percent(answerOf(one).probability, 1)}</td>
            <td class="number">{size(one.body_bytes)}</td>
            <td>{one.truth ? (one.truth.T_map_sensor ? "known" : "not in the map") : ""}</td>
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
