// Which nodes of the cloud to draw: those that look largest first, until there are enough points.

import type { CloudNode } from "./cloud";

export const MOST_POINTS = 1_500_000;
const FINEST_PX = 1.2; // between the points of a node: its children would show nothing more

export interface Eye {
  at: [number, number, number]; // from the root's low corner, metres
  pixelsPerTangent: number;
  sees: (low: [number, number, number], edge: number) => boolean;
}

/** Distance in pixels between neighbouring points of a node, where it is nearest to the eye. */
export function gapOf(node: CloudNode, eye: Eye): number {
  let squared = 0;
  for (let axis = 0; axis < 3; axis++) {
    const low = node.low[axis]!;
    const away = Math.max(low - eye.at[axis]!, eye.at[axis]! - low - node.edge, 0);
    squared += away * away;
  }
  return ((node.edge / 128) * eye.pixelsPerTangent) / Math.max(Math.sqrt(squared), node.edge / 64);
}

/** The nodes to draw, the most important first: a parent always before its children. */
export function choose(root: CloudNode, eye: Eye, mostPoints = MOST_POINTS): CloudNode[] {
  const chosen: CloudNode[] = [];
  const waiting: { node: CloudNode; gap: number }[] = [{ node: root, gap: Infinity }];
  let drawn = 0;
  while (waiting.length) {
    let best = 0;
    for (let i = 1; i < waiting.length; i++) if (waiting[i]!.gap > waiting[best]!.gap) best = i;
    const [{ node, gap }] = waiting.splice(best, 1) as [{ node: CloudNode; gap: number }];
    if (drawn + node.count > mostPoints) break;
    chosen.push(node);
    drawn += node.count;
    if (gap < FINEST_PX) continue;
    for (const child of node.children)
      if (eye.sees(child.low, child.edge)) waiting.push({ node: child, gap: gapOf(child, eye) });
  }
  return chosen;
}
