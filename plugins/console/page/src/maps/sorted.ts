// The order of the list of maps, and which of them are looked for.

import type { Schemas } from "../api/client";
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
  return found
    .map((one) => ({ one, key: keyOf(one) ?? null }))
    .sort((a, b) => {
      if (a.key === null || b.key === null) return Number(a.key === null) - Number(b.key === null);
      const order = a.key < b.key ? -1 : a.key > b.key ? 1 : 0;
      return isDown ? -order : order;
    })
    .map(({ one }) => one);
}
