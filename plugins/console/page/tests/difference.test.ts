// Points that one cloud has and the other has not.

import assert from "node:assert/strict";
import { test } from "node:test";
import { onlyIn } from "../src/patch/difference.ts";

const points = (...all: number[]) => new Float32Array(all);

test("a point of both clouds is no difference, though it was rounded otherwise", () => {
  const before = points(1, 1, 1, 2.0007, 3, 0.5);
  const after = points(1.0008, 0.9994, 1, 2, 3, 0.5);
  assert.deepEqual(onlyIn(after, before, 0.001), points());
  assert.deepEqual(onlyIn(before, after, 0.001), points());
});

test("a point of one of them is found, also close to one of both", () => {
  const before = points(0, 0, 0, 5, 5, 5);
  const after = points(5, 5, 5, 5.05, 5, 5);
  assert.deepEqual(onlyIn(after, before, 0.002), points(5.05, 5, 5));
  assert.deepEqual(onlyIn(before, after, 0.002), points(0, 0, 0));
});

test("all points are found where the other cloud has none", () => {
  assert.deepEqual(onlyIn(points(1, 2, 3), points(), 0.01), points(1, 2, 3));
  assert.deepEqual(onlyIn(points(), points(1, 2, 3), 0.01), points());
});

test("each point of a grid that lost one layer is told, over a wide area as well", () => {
  for (const step of [0.1, 40]) {
    const [whole, rest]: [number[], number[]] = [[], []];
    for (let x = 0; x < 20; x++) for (let y = 0; y < 20; y++) for (let z = 0; z < 4; z++) {
      whole.push(step * x, step * y, step * z);
      if (z !== 2) rest.push(step * x, step * y, step * z);
    }
    assert.equal(onlyIn(points(...whole), points(...rest), 0.002).length / 3, 400);
    assert.equal(onlyIn(points(...rest), points(...whole), 0.002).length, 0);
  }
});
