// A map's place on the Earth, in words.

import type { Schemas } from "../api/client";

type Place = Schemas["GeoreferenceRecord"];

export function placeText({ latitude_deg, longitude_deg, height_m, x_axis_deg, anchor_m }: Place): string {
  const anchor = anchor_m.some((metres) => metres !== 0) ? `The point ${anchor_m.join(", ")} m of the map` : "The map's origin";
  const compass = ((((90 - x_axis_deg) % 360) + 360) % 360).toFixed(1);
  return `${anchor} lies at ${latitude_deg}°, ${longitude_deg}°, ${height_m} m above the WGS84 ellipsoid. The map's x axis points to ${compass}° on a compass.`;
}

/** Whether the map's z axis does not point up there. */
export function isTilted({ quaternion }: Place): boolean {
  return Math.hypot(quaternion[0]!, quaternion[1]!) > 1e-9;
}
