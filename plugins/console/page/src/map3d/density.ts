// How far apart the points of the drawn nodes are, so that each is as large as it takes to close the surface.

import type { Part } from "./levels";

const CELLS = 128; // of a node's edge: one point each at most

/** Metres between the points around those of each node, by its key. A parent is as dense as its children that are drawn. */
export function spacingOf(drawn: Part[]): Map<string, number> {
  const found = new Map<string, number>();
  for (const { node, count } of [...drawn].sort((a, b) => b.node.level - a.node.level)) {
    const finer = node.children.map(({ key }) => found.get(key)).filter((m) => m !== undefined);
    // a sheet through the node: so many points on its edge squared
    const whole = Math.max(node.edge / CELLS, node.edge / Math.sqrt(Math.max(node.count, 1)));
    const own = whole * Math.sqrt(node.count / Math.max(count, 1));
    found.set(node.key, finer.length ? Math.min(own, Math.max(...finer)) : own);
  }
  return found;
}
