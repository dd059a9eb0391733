// Whether a recorded answer is wrong by what somebody told of its scan.

import type { Schemas } from "../api/client";
import type { RecordedQuery } from "./place";

const RIGHT_M = 1; // what a false accept is, as the lab counts it
const RIGHT_DEG = 10;

export interface Judgement {
  kind: "false" | "disputed"; // localized and wrong; rejected although the scan was taken there
  text: string;
}

/** Of an answer about a map; null: nobody told, or it is right, or it is about another map. */
export function judgementOf({ truth, map_id: asked }: RecordedQuery, answer: Schemas["Answer"], map: string): Judgement | null {
  if (!truth) return null;
  const { verdict, map_id, T_map_sensor: given } = answer;
  if (verdict === "rejected") {
    const isHere = truth.map_id === map && truth.T_map_sensor;
    return isHere ? { kind: "disputed", text: "was rejected, and its scan was taken in this map" } : null;
  }
  if (!given || (map_id || asked) !== map) return null;
  if (truth.map_id !== map) return { kind: "false", text: `was localized, and its scan was taken in ${truth.map_id}` };
  if (!truth.T_map_sensor) return { kind: "false", text: "was localized, and its scan was not taken in this map" };
  const [m, degrees] = [metresApart(given, truth.T_map_sensor), degreesApart(given, truth.T_map_sensor)];
  if (m <= RIGHT_M && degrees <= RIGHT_DEG) return null;
  return { kind: "false", text: `is ${m.toFixed(1)} m and ${degrees.toFixed(0)}° off the place that was told` };
}

function metresApart(a: Schemas["Pose"], b: Schemas["Pose"]): number {
  return Math.hypot(...a.position.map((m, axis) => m - b.position[axis]!));
}

function degreesApart(a: Schemas["Pose"], b: Schemas["Pose"]): number {
  const [one, other] = [a.quaternion, b.quaternion];
  const lengths = Math.hypot(...one) * Math.hypot(...other);
  const dot = one.reduce((sum, part, i) => sum + part * other[i]!, 0) / lengths;
  return (2 * Math.acos(Math.min(1, Math.abs(dot))) * 180) / Math.PI;
}
