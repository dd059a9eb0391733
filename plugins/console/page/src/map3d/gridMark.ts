// A level grid at the height of the lowest floor, along the axes of the map and at its round coordinates.

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "three";
import { token } from "../ui/token";
import type { Box } from "./bulk";
import { gridStep } from "./gridStep";

const OPACITY = 0.4;

/** `box`: of the map, from the cloud's low corner; `origin`: that corner in the map's frame. */
export function gridMark(box: Box, origin: readonly number[]): LineSegments {
  const step = gridStep(box);
  const [low, high] = box;
  const z = low[2];
  const ends: number[] = [];
  for (const axis of [0, 1] as const) {
    const other = 1 - axis;
    const first = Math.ceil((low[axis] + origin[axis]!) / step) * step - origin[axis]!;
    for (let at = first; at <= high[axis]; at += step) {
      for (const end of [low[other]!, high[other]!]) ends.push(...(axis === 0 ? [at, end, z] : [end, at, z]));
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: token("mark-other"), transparent: true, opacity: OPACITY }));
}
