// The choice of nodes holds its budget, and what is nearest comes first.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { CloudNode } from "../src/map3d/cloud.ts";
import { choose, type Eye, gapOf } from "../src/map3d/levels.ts";

type Triple = [number, number, number];

/** A full octree over a flat world: four children a node. */
function tree(levels: number, count: number, level = 0, low: Triple = [0, 0, 0], edge = 1024): CloudNode {
  const children: CloudNode[] = [];
  for (let i = 0; level < levels && i < 4; i++) {
    const half = edge / 2;
    children.push(tree(levels, count, level + 1, [low[0] + (i & 1) * half, low[1] + (i >> 1) * half, low[2]], half));
  }
  return { key: `${level}/${low.join("/")}`, level, low, edge, first: 0, count, children };
}

function all(node: CloudNode): CloudNode[] {
  return [node, ...node.children.flatMap(all)];
}

const near: Eye = { at: [10, 10, 5], pixelsPerTangent: 700, sees: () => true };
const world = tree(6, 10_000); // 5461 nodes, 54 million points

test("the points of the chosen nodes never exceed the budget, and use it", () => {
  assert.equal(all(world).length, 5461);
  for (const budget of [9_999, 10_000, 100_000, 1_500_000]) {
    assert.equal(choose(world, near, budget).reduce((sum, { count }) => sum + count, 0), budget);
  }
});

test("where even the coarsest node is too much, some of its points are drawn", () => {
  assert.deepEqual(choose(world, near, 4_000.7), [{ node: world, count: 4_000 }]);
  const some = choose(world, near, 25_000);
  assert.deepEqual(some.map(({ count }) => count), [10_000, 10_000, 5_000]);
});

test("a node comes after its parent, and the order is that of the gaps among those that wait", () => {
  const chosen = choose(world, near).map(({ node }) => node);
  const seen = new Set<string>();
  const parents = new Map(all(world).flatMap((node) => node.children.map((child) => [child.key, node.key])));
  let waiting: CloudNode[] = [world];
  for (const node of chosen) {
    const parent = parents.get(node.key);
    assert.ok(parent === undefined || seen.has(parent));
    const largest = Math.max(...waiting.map((one) => (one === world ? Infinity : gapOf(one, near))));
    assert.equal(node === world ? Infinity : gapOf(node, near), largest);
    waiting = [...waiting.filter((one) => one !== node), ...node.children];
    seen.add(node.key);
  }
});

test("what is near is finer than what is far", () => {
  const finest = choose(world, near).map(({ node }) => node).filter(({ level }) => level === 6);
  assert.ok(finest.length > 0);
  assert.ok(finest.every(({ low }) => Math.hypot(low[0], low[1]) < 400));
});

test("what is not seen is not chosen, and its children neither", () => {
  const left: Eye = { ...near, sees: (low) => low[0] < 512 };
  const chosen = choose(world, left).map(({ node }) => node);
  assert.ok(chosen.length > 100);
  assert.ok(chosen.every(({ low }) => low[0] < 512));
});

test("from far away the coarse nodes are enough", () => {
  const far: Eye = { ...near, at: [512, 512, 100_000] };
  const levels = choose(world, far).map(({ node }) => node.level);
  assert.ok(levels.length >= 1 && Math.max(...levels) <= 1);
});
