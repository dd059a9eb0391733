import assert from "node:assert/strict";
import { test } from "node:test";
import type { Box } from "../src/map3d/bulk.ts";
import { gridStep } from "../src/map3d/gridStep.ts";

const box = (x: number, y: number): Box => [[0, 0, 0], [x, y, 3]];

test("the lines are round metres apart, and not too many", () => {
  assert.equal(gridStep(box(16, 12)), 1);
  assert.equal(gridStep(box(30, 100)), 5);
  assert.equal(gridStep(box(600, 40)), 50);
  assert.equal(gridStep(box(0, 0)), 0.05);
});
