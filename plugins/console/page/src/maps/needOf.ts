// What needs a person now: maps that cannot answer, that are not good, or whose robots are lost.

import type { Schemas } from "../api/client";
import type { MapCounts } from "./answerCounts";
import { judgedBySummary } from "./manifest";

const MIN = 5; // answers: fewer say nothing
const LOST = 0.5; // of the answers of an hour

export interface Need {
  text: string;
  path: string[]; // of the view where it is dealt with
  query?: Record<string, string>;
}

export function needOf(map: Schemas["MapSummary"], counts: MapCounts | undefined): Need | null {
  const { map_id: id, active_version: version } = map;
  if (!version) return { text: "has no active version: robots that ask it are refused", path: ["maps", id, "versions"] };
  const { answered = 0, localized = 0 } = counts?.hour ?? {};
  if (answered >= MIN && localized < LOST * answered) {
    const lost = answered - localized;
    return { text: `${lost} of ${answered} queries of the last hour were not localized`, path: ["recorded-queries"], query: { map: id } };
  }
  if (judgedBySummary(map).grade === "poor") {
    return { text: "is poor by its self-test", path: ["maps", id], query: { layers: "localizability" } };
  }
  return null;
}
