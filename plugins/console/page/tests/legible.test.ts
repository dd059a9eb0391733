// What makes a map legible: the box without strays, the floor, the size of points, the bar.

import assert from "node:assert/strict";
import { test } from "node:test";
import { type Box, bulkOf } from "../src/map3d/bulk.ts";
import type { Cloud, CloudNode } from "../src/map3d/cloud.ts";
import { spacingOf } from "../src/map3d/density.ts";
import { FLOOR_CELLS, floorOf } from "../src/map3d/floor.ts";
import { fromAbove } from "../src/map3d/framed.ts";
import { barOf } from "../src/map3d/orientation.ts";

type Triple = [number, number, number];
const EDGE = 1024;

/** Points as a node has them. */
function packed(points: Triple[], edge = EDGE): ArrayBuffer {
  const found = new DataView(new ArrayBuffer(8 * points.length));
  points.forEach((point, i) => point.forEach((m, axis) => found.setUint16(8 * i + 2 * axis, (m / edge) * 65535, true)));
  return found.buffer as ArrayBuffer;
}

function node(low: Triple, edge: number, count: number, children: CloudNode[] = []): CloudNode {
  return { key: `${low.join("/")}/${edge}`, level: Math.log2(EDGE / edge), low, edge, first: 0, count, children };
}

function cloudOf(root: CloudNode, bounds: Box): Cloud {
  const index = { low_m: [0, 0, 0], bounds_m: bounds, edge_m: root.edge } as unknown as Cloud["index"];
  return { index, root, path: "" };
}

function near(found: Box, expected: Box, m: number): void {
  found.flat().forEach((value, i) => assert.ok(Math.abs(value - expected.flat()[i]!) <= m, `${found.join()} is not ${expected.join()}`));
}

test("a few points far away do not belong to the box that is framed", () => {
  const hall = Array.from({ length: 2000 }, (_, i): Triple => [100 + (i % 50), 200 + Math.floor(i / 50), (i * 7) % 5]);
  const root = packed([...hall, [1000, 1000, 900], [3, 5, 700]]);
  const bounds: Box = [[3, 5, 0], [1000, 1000, 900]];
  near(bulkOf(cloudOf(node([0, 0, 0], EDGE, 2002), bounds), root, new Float32Array()), [[100, 200, 0], [149, 239, 4]], 1);
});

test("strays in nodes of their own do not, either, and a place where robots stand does", () => {
  const children = [node([0, 0, 0], 512, 500_000), node([512, 512, 512], 512, 40)];
  const cloud = cloudOf(node([0, 0, 0], EDGE, 10_000, children), [[0, 0, 0], [1000, 1000, 900]]);
  near(bulkOf(cloud, packed([]), new Float32Array()), [[0, 0, 0], [512, 512, 512]], 0);
  near(bulkOf(cloud, packed([]), new Float32Array([700, 40, 2])), [[0, 0, 0], [700, 512, 512]], 0);
});

test("the floor follows a slope, and heights are counted from it", () => {
  const points: Triple[] = [];
  for (let x = 4; x < EDGE; x += 8)
    for (let y = 4; y < EDGE; y += 8) points.push([x, y, 50 + x / 10], [x, y, 50 + x / 10 + (y % 16 ? 6 : 0)]);
  const { heights, high } = floorOf(packed(points), EDGE, []);
  for (const cell of [2, 16, 29]) {
    const x = ((cell + 0.5) * EDGE) / FLOOR_CELLS;
    assert.ok(Math.abs(heights[16 * FLOOR_CELLS + cell]! - (50 + x / 10)) < 5, `${heights[16 * FLOOR_CELLS + cell]}`);
  }
  assert.ok(high > 4 && high < 12, String(high));
});

test("each storey has a floor of its own", () => {
  const points: Triple[] = [];
  for (let x = 4; x < EDGE; x += 8) for (let y = 4; y < EDGE; y += 8) points.push([x, y, 10], [x, y, 14]);
  const storeys = [{ name: "1", low: 8, high: 12 }, { name: "2", low: 12, high: 20 }];
  const { heights } = floorOf(packed(points), EDGE, storeys);
  const cells = FLOOR_CELLS ** 2;
  assert.equal(heights.length, 2 * cells);
  assert.ok(heights.subarray(0, cells).every((z) => Math.abs(z - 10) < 0.1));
  assert.ok(heights.subarray(cells).every((z) => Math.abs(z - 14) < 0.1));
});

test("points are as large as what is between them, and smaller where finer ones are drawn", () => {
  const child = node([0, 0, 0], 512, 20_000);
  const root = node([0, 0, 0], EDGE, 20_000, [child, node([512, 0, 0], 512, 1000)]);
  const whole = (one: CloudNode) => ({ node: one, count: one.count });
  const alone = spacingOf([whole(root)]).get(root.key)!;
  const both = spacingOf([whole(root), whole(child)]);
  assert.equal(alone, EDGE / 128);
  assert.equal(both.get(root.key), both.get(child.key));
  assert.ok(both.get(child.key)! < alone);
  const sparse = node([0, 0, 0], EDGE, 100);
  assert.ok(spacingOf([whole(sparse)]).get(sparse.key)! > alone);
  const quarter = spacingOf([{ node: root, count: root.count / 4 }]).get(root.key)!;
  assert.equal(quarter, 2 * alone, "of a quarter of a sheet's points");
});

test("from above, all of a box is in the picture, its top nearest to the eye", () => {
  for (const aspect of [0.5, 1, 3]) {
    const { target, eye } = fromAbove([0, 0, 0], [60, 20, 8], 55, aspect);
    assert.deepEqual(eye.slice(0, 2), target.slice(0, 2));
    const tall = Math.tan((55 * Math.PI) / 360) * (eye[2] - 8);
    assert.ok(tall >= 10 && tall * aspect >= 30);
    assert.ok(Math.min(tall / 10, (tall * aspect) / 30) < 1.1);
  }
});

test("the bar is the longest round length that has room", () => {
  for (const metresPerPixel of [0.0004, 0.013, 0.1, 1.7, 40]) {
    const { m, px } = barOf(metresPerPixel, 110);
    assert.ok(px <= 110 && px > 110 / 2.6);
    assert.ok([1, 2, 5].includes(Number((m / 10 ** Math.floor(Math.log10(m) + 1e-9)).toFixed(6))), String(m));
    assert.ok(Math.abs(m / px - metresPerPixel) < 1e-9);
  }
});
