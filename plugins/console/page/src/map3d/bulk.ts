// The box that holds a map but for its strays: what the camera frames. A few points far away, seen through a window or
// made by a mirror, would make the map itself a dot.

import type { Cloud, CloudNode } from "./cloud";

type Triple = [number, number, number];
export type Box = [Triple, Triple]; // low and high corner, metres from the cloud's low corner

const STRAY_SHARE = 0.02; // of the points, on each side: an end wall has more
const POINT_BYTES = 8;

/** `root` holds the points of the cloud's root, `templates` (x, y, z) of its templates: where robots stand is no stray. */
export function bulkOf(cloud: Cloud, root: ArrayBuffer, templates: Float32Array): Box {
  const parts = cloud.root.children.length ? leavesOf(cloud.root) : pointsOf(root, cloud.root.edge);
  const { low_m: origin, bounds_m: bounds } = cloud.index;
  const box: Box = [[0, 0, 0], [0, 0, 0]];
  for (const axis of [0, 1, 2]) {
    const [lowest, highest] = bounds.map((corner) => corner[axis]! - origin[axis]!) as [number, number];
    let [low, high] = [cut(parts, axis, false), cut(parts, axis, true)];
    for (let i = axis; i < templates.length; i += 3) {
      low = Math.min(low, templates[i]!);
      high = Math.max(high, templates[i]!);
    }
    box[0][axis] = Math.max(low, lowest);
    box[1][axis] = Math.min(high, highest);
  }
  return box;
}

interface Part {
  low: Triple;
  edge: number;
  count: number;
}

function leavesOf(node: CloudNode): Part[] {
  return node.children.length ? node.children.flatMap(leavesOf) : [node];
}

function pointsOf(root: ArrayBuffer, edge: number): Part[] {
  const packed = new DataView(root);
  return Array.from({ length: root.byteLength / POINT_BYTES }, (_, i) => ({
    low: [0, 2, 4].map((at) => (packed.getUint16(i * POINT_BYTES + at, true) / 65535) * edge) as Triple,
    edge: 0,
    count: 1,
  }));
}

/** Where the strays of one side end along an axis. */
function cut(parts: Part[], axis: number, isHigh: boolean): number {
  const sideOf = ({ low, edge }: Part) => low[axis]! + (isHigh ? edge : 0);
  const sorted = [...parts].sort((a, b) => (isHigh ? sideOf(b) - sideOf(a) : sideOf(a) - sideOf(b)));
  const all = parts.reduce((sum, { count }) => sum + count, 0);
  let passed = 0;
  for (const part of sorted) {
    passed += part.count;
    if (passed > STRAY_SHARE * all) return sideOf(part);
  }
  return sorted.length ? sideOf(sorted.at(-1)!) : 0;
}
