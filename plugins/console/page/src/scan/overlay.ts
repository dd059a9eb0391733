// The scan laid over the map at a pose, in the colours of what the map says about each point.

import { Color, type Group } from "three";
import { overlayPoints } from "../api/scans";
import { colouredDots, type Pose } from "../map3d/marks";
import type { MapScene } from "../map3d/scene";
import { token } from "../ui/token";

export interface OverlayShares {
  agrees: number;
  contradicts: number;
  unexplained: number;
}

// by the class of a point: the colours of the key beside the picture
const COLOURS = ["mark-agrees", "mark-contradicts", "mark-unexplained"];
const POINT_BYTES = 16; // x, y, z as float32 from the pose, along the map's axes; then the class

export async function drawOverlay(
  scene: MapScene,
  group: Group,
  map: string,
  version: string,
  pose: Pose,
  scan: { type: string; encoding: string; body: Blob },
  signal: AbortSignal,
): Promise<OverlayShares> {
  const data = new DataView(await overlayPoints(map, version, pose, scan, signal));
  const count = data.byteLength / POINT_BYTES;
  const positions = new Float32Array(count * 3);
  const colours = new Float32Array(count * 3);
  const shares = [0, 0, 0];
  const tints = COLOURS.map((name) => new Color(token(name)).toArray());
  const middle = scene.local(pose.position).toArray();
  for (let i = 0; i < count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      positions[3 * i + axis] = data.getFloat32(POINT_BYTES * i + 4 * axis, true) + middle[axis]!;
    }
    const kind = data.getUint32(POINT_BYTES * i + 12, true);
    shares[kind]! += 1;
    colours.set(tints[kind]!, 3 * i);
  }
  if (!signal.aborted && count) {
    group.add(colouredDots(positions, colours, 4));
    scene.redraw();
  }
  return { agrees: shares[0]!, contradicts: shares[1]!, unexplained: shares[2]! };
}
