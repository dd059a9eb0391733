// The order of the recorded queries that are listed.

import type { Schemas } from "../api/client";
import { inOrder } from "../ui/inOrder.ts"; // by its whole name: Node runs this in tests

type Recorded = Pick<Schemas["RecordedQueryDetails"], "time" | "map_id" | "body_bytes" | "truth" | "answer">;
export type Column = "when" | "map" | "verdict" | "probability" | "size" | "truth";
export interface Order {
  column: Column;
  isDown: boolean;
}

export const NEWEST: Order = { column: "when", isDown: true };

export function sorted<One extends Recorded>(queries: readonly One[], { column, isDown }: Order): One[] {
  const keyOf = ({ time, map_id, body_bytes, truth, answer }: One): string | number | null | undefined => {
    const { verdict, probability } = answer as unknown as Schemas["Answer"];
    if (column === "when") return Date.parse(time);
    if (column === "map") return map_id;
    if (column === "verdict") return verdict;
    if (column === "probability") return probability;
    if (column === "size") return body_bytes;
    return truth && (truth.T_map_sensor ? "known" : "not in the map");
  };
  return inOrder(queries, keyOf, isDown);
}

/** The order after a click on a column's head: the other way round, or by this column. Times and figures begin with the most. */
export function clicked(order: Order, column: Column): Order {
  const isText = column === "map" || column === "verdict" || column === "truth";
  return { column, isDown: order.column === column ? !order.isDown : !isText };
}
