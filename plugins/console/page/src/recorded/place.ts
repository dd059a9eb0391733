// Where a kept query is shown in a map: where it was taken, if somebody told, else the best place of its answer.

import type { Schemas } from "../api/client";
import type { Pose } from "../map3d/marks";

export type Sample = Schemas["Sample"];

export function answerOf(sample: Sample): Schemas["Answer"] {
  return sample.answer as unknown as Schemas["Answer"];
}

/** The map that a view of the query opens. */
export function mapOf(sample: Sample): string {
  return answerOf(sample).map_id || sample.map_id.split(",")[0] || "";
}

export function placeIn(sample: Sample, map: string): Pose | null {
  if (sample.truth) return sample.truth.map_id === map ? (sample.truth.T_map_sensor ?? null) : null;
  const answer = answerOf(sample);
  const best = answer.hypotheses.find((one) => (one.map_id || answer.map_id || sample.map_id) === map);
  return best?.T_map_sensor ?? null;
}
