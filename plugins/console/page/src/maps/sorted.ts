// The order of the list of maps, and which of them are looked for.

import type { Schemas } from "../api/client";
import { inOrder } from "../ui/inOrder.ts"; // by its whole name: Node runs this in tests
import type { MapCounts } from "./answerCounts";

type MapSummary = Schemas["MapSummary"];
export type Column = "map" | "localized" | "wrong" | "hour" | "day" | "published" | "size";
export interface Order {
  column: Column;
  isDown: boolean;
}

/** The maps whose name holds the words, in an order. What a map does not have stands last. */
export function sorted(
  maps: readonly MapSummary[],
  counts: ReadonlyMap<string, MapCounts>,
  words: string,
  { column, isDown }: Order,
): MapSummary[] {
  const keyOf = ({ map_id, published_time, summary }: MapSummary): string | number | null | undefined => {
    const asked = counts.get(map_id);
    if (column === "map") return map_id;
    if (column === "localized") return summary.localized;
    if (column === "wrong") return summary.false_accepts;
    if (column === "hour") return asked?.hour.answered;
    if (column === "day") return asked?.day.answered;
    if (column === "published") return published_time;
    return summary.size_m && summary.size_m[0]! * summary.size_m[1]!;
  };
  const found = maps.filter(({ map_id }) => map_id.includes(words.trim().toLowerCase()));
  return inOrder(found, keyOf, isDown);
}
