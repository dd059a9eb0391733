// What a link to a tried scan says: the pose by hand and what it is for, and the spot of a simulated scan.

import type { HandPose } from "./handPose";

type Position = [number, number, number];

/** What the pose by hand is used for, besides being looked at. */
export const HAND_USES = ["prior", "tilt", "overlay"] as const;
export type HandUse = (typeof HAND_USES)[number];

/** "x,y,z" in metres. Other texts are no spot. */
export function spotOf(text: string | null): Position | null {
  const numbers = numbersOf(text, 3);
  return numbers && (numbers as Position);
}

export function spotText(spot: readonly number[]): string {
  return spot.map((m) => m.toFixed(3)).join(",");
}

/** "x,y,z,roll,pitch,yaw,radius,yaw range" in metres and degrees. Other texts are no pose. */
export function handOf(text: string | null): HandPose | null {
  const numbers = numbersOf(text, 8);
  if (!numbers) return null;
  const [x, y, z, roll_deg, pitch_deg, yaw_deg, radius_m, yaw_range_deg] = numbers as [...Position, number, number, number, number, number];
  if (radius_m <= 0 || yaw_range_deg <= 0 || yaw_range_deg > 180) return null;
  return { position: [x, y, z], roll_deg, pitch_deg, yaw_deg, radius_m, yaw_range_deg };
}

export function handText(hand: HandPose | null): string {
  if (!hand) return "";
  const { position, roll_deg, pitch_deg, yaw_deg, radius_m, yaw_range_deg } = hand;
  return [...position, roll_deg, pitch_deg, yaw_deg, radius_m, yaw_range_deg].map((one) => String(Number(one.toFixed(3)))).join(",");
}

export function usesOf(text: string | null): HandUse[] {
  const asked = text?.split(",") ?? [];
  return HAND_USES.filter((one) => asked.includes(one));
}

/** Number of a hypothesis from 0. */
export function placeOf(text: string | null): number {
  return /^\d{1,4}$/.test(text ?? "") ? Number(text) : 0;
}

function numbersOf(text: string | null, count: number): number[] | null {
  const parts = text?.split(",") ?? [];
  const numbers = parts.map(Number);
  return parts.length === count && parts.every(Boolean) && numbers.every(Number.isFinite) ? numbers : null;
}
