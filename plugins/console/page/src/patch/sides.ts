// The two pictures of a patch: what is drawn in each, and the one camera of both.

import type { Cloud } from "../map3d/cloud";
import { NotedView } from "../map3d/addressedView";
import type { View } from "../map3d/framed";
import { dotsOver, outlineMark } from "../map3d/marks";
import type { MapScene } from "../map3d/scene";
import { laid } from "../map3d/useLayerMarks";
import type { PatchedArea } from "../maps/manifest";
import { token } from "../ui/token";
import { onlyIn } from "./difference";
import { type Box, pointsIn } from "./pointsIn";

const CELL_M = 0.5; // around an area, points of its things are changed as well
const SAME_M = 0.002; // apart, besides what the clouds round
const MIN_AWAY_M = 6;
const AWAY = 2.5; // of an area's diagonal
const DOT_PX = 4;

export interface Side {
  scene: MapScene;
  cloud: Cloud;
}

/** Points by kind: x, y, z one after the other, from the low corner of `box`. */
export interface Changed {
  box: Box;
  added: Float32Array;
  removed: Float32Array;
}

/** The points of an area that a patch added and removed: those that one version's cloud has and the other's has not. */
export async function changedPoints(before: Cloud, after: Cloud, area: PatchedArea, signal: AbortSignal): Promise<Changed> {
  const box = { low: area.low_m.map((m) => m - CELL_M), high: area.high_m.map((m) => m + CELL_M) };
  const [old, now] = await Promise.all([before, after].map((cloud) => pointsIn(cloud, box, signal)));
  const within_m = SAME_M + old!.blur_m + now!.blur_m;
  return { box, added: onlyIn(now!.at, old!.at, within_m), removed: onlyIn(old!.at, now!.at, within_m) };
}

/** Outlines an area in a picture, and marks its points that the other picture has not. Returns what takes it away. */
export function marked(scene: MapScene, area: PatchedArea, box: Box | null, points: Float32Array, colour: string): () => void {
  const outline = outlineMark(scene.local(area.low_m), scene.local(area.high_m), token("mark-chosen"));
  const ends = [laid(scene, outline)];
  if (box && points.length) {
    const dots = dotsOver(points, token(colour), DOT_PX);
    dots.position.copy(scene.local(box.low));
    ends.push(laid(scene, dots));
  }
  return () => ends.forEach((end) => end());
}

/** Looks at an area from the south, steeply, so that few walls stand before it. */
export function lookAt({ scene }: Side, { low_m, high_m }: PatchedArea): void {
  const [x, y, z] = low_m.map((m, axis) => (m + high_m[axis]!) / 2) as [number, number, number];
  const away = Math.max(MIN_AWAY_M, AWAY * Math.hypot(...low_m.map((m, axis) => high_m[axis]! - m)));
  scene.view = { target: [x, y, z], eye: [x, y - 0.4 * away, z + 0.9 * away] };
}

/** Keeps the pictures at one camera, and notes it in the address. Returns what ends it. */
export function linked(sides: readonly Side[]): () => void {
  const noted = new NotedView();
  let isFollowing = false; // a picture that follows does not lead
  for (const { scene } of sides) {
    scene.moved = (view: View) => {
      if (isFollowing) return;
      noted.moved(view);
      isFollowing = true;
      for (const other of sides) if (other.scene !== scene) other.scene.view = view;
      isFollowing = false;
    };
  }
  return () => {
    noted.end();
    for (const { scene } of sides) scene.moved = () => {};
  };
}
