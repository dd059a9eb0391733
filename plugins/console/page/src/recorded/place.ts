// Where a recorded query is shown in a map: where it was taken, if somebody told, else the best place of its answer.

import type { Schemas } from "../api/client";
import type { Pose } from "../map3d/marks";

export type RecordedQuery = Schemas["RecordedQueryDetails"];

export function answerOf(recorded: RecordedQuery): Schemas["Answer"] {
  return recorded.answer as unknown as Schemas["Answer"];
}

/** The map that a view of the query opens. */
export function mapOf(recorded: RecordedQuery): string {
  return answerOf(recorded).map_id || recorded.map_id.split(",")[0] || "";
}

export function placeIn(recorded: RecordedQuery, map: string): Pose | null {
  if (recorded.truth) return recorded.truth.map_id === map ? (recorded.truth.T_map_sensor ?? null) : null;
  const answer = answerOf(recorded);
  const best = answer.hypotheses.find((one) => (one.map_id || answer.map_id || recorded.map_id) === map);
  return best?.T_map_sensor ?? null;
}
