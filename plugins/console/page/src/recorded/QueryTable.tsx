import { useSignal } from "@preact/signals";
import { mayAdminister } from "../access/session";
import { link } from "../router";
import { whyOf } from "../scan/why";
import { chance, short, size } from "../ui/text";
import { SortHead } from "../ui/SortHead";
import { When } from "../ui/When";
import { Verdict } from "../ui/Verdict";
import { answerOf, mapOf, type RecordedQuery } from "./place";
import { clicked, type Column, NEWEST, sorted } from "./sorted";

export interface QueryTableProps {
  queries: RecordedQuery[];
  remove: (recorded: RecordedQuery) => void;
  point: (queryId: string) => void; // "": at none
}

/** Recorded queries, one a row, sorted by the column that was clicked. */
export function QueryTable({ queries, remove, point }: QueryTableProps) {
  const order = useSignal(NEWEST);
  const head = (column: Column, name: string, isNumber = false) => (
    <SortHead
      isSorted={order.value.column === column}
      isDown={order.value.isDown}
      isNumber={isNumber}
      sort={() => (order.value = clicked(order.value, column))}
    >
      {name}
    </SortHead>
  );
  return (
    <table class="cards">
      <thead>
        <tr>
          {head("when", "When")}
          {head("map", "Map")}
          {head("verdict", "Verdict")}
          <th>Why</th>
          {head("probability", "Probability", true)}
          <th>Request</th>
          {head("size", "Size", true)}
          {head("truth", "Truth")}
          <th>
            <span class="unseen">Actions</span>
          </th>
        </tr>
      </thead>
      <tbody>
        {sorted(queries, order.value).map((one) => (
          <tr key={one.query_id} onPointerEnter={() => point(one.query_id)} onPointerLeave={() => point("")}>
            <td data-name="When">
              <When iso={one.time} />
            </td>
            <td data-name="Map">{one.map_id || "any"}</td>
            <td data-name="Verdict">
              <Verdict verdict={answerOf(one).verdict} />
            </td>
            <td data-name="Why">{answerOf(one).verdict === "localized" ? "" : whyOf(answerOf(one), leastAsked(one)).join(" ")}</td>
            <td class="number" data-name="Probability">{chance(answerOf(one).probability)}</td>
            <td data-name="Request">
              <span>
                <code title={`request ${one.request_id}`}>{short(one.request_id)}</code> <small>{one.transport}</small>
              </span>
            </td>
            <td class="number nowrap" data-name="Size">{size(one.body_bytes)}</td>
            <td data-name="Truth">{one.truth ? (one.truth.T_map_sensor ? "known" : "not in the map") : ""}</td>
            <td class="actions">
              {mapOf(one) ? (
                <a href={link(["maps", mapOf(one), "try"], { recorded: one.query_id })} onFocus={() => point(one.query_id)}>
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
function leastAsked({ options }: RecordedQuery): number | null {
  return Number(options.min_probability) || null;
}
