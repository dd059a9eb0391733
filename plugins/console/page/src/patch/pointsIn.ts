// The points of a version's cloud that lie in a box of the map.

import { type Cloud, type CloudNode, pointsOfRun } from "../map3d/cloud";
import { runsOf } from "../map3d/loads";

const MAX_POINTS = 2_000_000; // of the nodes that touch the box: of a larger area the coarse levels alone
const STEPS = 65535; // of a point's coordinate along the edge of its node
const CELLS = 128; // along a node's edge, of which each has one point of that level at most

export interface Box {
  low: readonly number[];
  high: readonly number[];
}

export interface PointsIn {
  at: Float32Array; // x, y, z one after the other, from the box's low corner
  blur_m: number; // how far a point that two clouds share may lie apart in them, along an axis, for this one's part
}

export async function pointsIn(cloud: Cloud, box: Box, signal: AbortSignal): Promise<PointsIn> {
  const local = (corner: readonly number[]) => corner.map((m, axis) => m - cloud.index.low_m[axis]!);
  const [low, high] = [local(box.low), local(box.high)];
  const { nodes, gap_m } = nodesIn(cloud.root, low, high);
  const found: number[] = [];
  for (const run of runsOf(nodes)) {
    const parts = await pointsOfRun(cloud, run, signal);
    run.forEach((node, i) => take(node, new Uint16Array(parts[i]!), low, high, found));
  }
  return { at: new Float32Array(found), blur_m: cloud.index.edge_m / STEPS + gap_m };
}

/** The nodes that touch a box, level by level, and the gap between points that the levels left out would close. */
function nodesIn(root: CloudNode, low: number[], high: number[]): { nodes: CloudNode[]; gap_m: number } {
  const nodes: CloudNode[] = [];
  let points = 0;
  for (let level = [root]; level.length; level = level.flatMap(({ children }) => children)) {
    level = level.filter((node) => node.low.every((m, axis) => m <= high[axis]! && m + node.edge >= low[axis]!));
    points += level.reduce((sum, { count }) => sum + count, 0);
    if (nodes.length && points > MAX_POINTS) return { nodes, gap_m: nodes.at(-1)!.edge / (CELLS / 2) };
    nodes.push(...level);
  }
  return { nodes, gap_m: 0 };
}

function take(node: CloudNode, packed: Uint16Array, low: number[], high: number[], into: number[]): void {
  const scale = node.edge / STEPS;
  const at = [0, 0, 0];
  for (let i = 0; i < packed.length; i += 4) {
    let isInside = true;
    for (let axis = 0; axis < 3; axis++) {
      const m = node.low[axis]! + packed[i + axis]! * scale;
      isInside &&= m >= low[axis]! && m <= high[axis]!;
      at[axis] = m - low[axis]!;
    }
    if (isInside) into.push(...at);
  }
}
