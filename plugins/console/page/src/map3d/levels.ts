// Which nodes of the cloud to draw: those that look coarsest first, until there are enough points.

import type { CloudNode } from "./cloud";

export const MAX_POINTS = 1_500_000;
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

/** A node of which the first `count` points are drawn. Their order is by chance, so that they lie all over it. */
export interface Part {
  node: CloudNode;
  count: number;
}

/** The nodes to draw, the most important first: a parent always before its children, and of the last one what is left. */
export function choose(root: CloudNode, eye: Eye, mostPoints = MAX_POINTS): Part[] {
  const chosen: Part[] = [];
  const waiting = new Waiting();
  waiting.push({ node: root, gap: Infinity });
  let drawn = 0;
  for (let next = waiting.pop(); next; next = waiting.pop()) {
    const { node, gap } = next;
    const count = Math.min(node.count, Math.floor(mostPoints) - drawn);
    if (count <= 0 && node.count > 0) break;
    chosen.push({ node, count });
    drawn += count;
    if (gap < FINEST_PX) continue;
    for (const child of node.children)
      if (eye.sees(child.low, child.edge)) waiting.push({ node: child, gap: gapOf(child, eye) });
  }
  return chosen;
}

interface Candidate {
  node: CloudNode;
  gap: number;
}

/** A binary heap, the largest gap on top: a frame may look at thousands of nodes. */
class Waiting {
  private readonly heap: Candidate[] = [];

  push(one: Candidate): void {
    const { heap } = this;
    let at = heap.push(one) - 1;
    while (at > 0) {
      const above = (at - 1) >> 1;
      if (heap[above]!.gap >= one.gap) break;
      heap[at] = heap[above]!;
      at = above;
    }
    heap[at] = one;
  }

  pop(): Candidate | undefined {
    const { heap } = this;
    const top = heap[0];
    const last = heap.pop();
    if (!last || !heap.length) return top;
    let at = 0;
    for (;;) {
      let below = 2 * at + 1;
      if (below >= heap.length) break;
      if (below + 1 < heap.length && heap[below + 1]!.gap > heap[below]!.gap) below += 1;
      if (heap[below]!.gap <= last.gap) break;
      heap[at] = heap[below]!;
      at = below;
    }
    heap[at] = last;
    return top;
  }
}
