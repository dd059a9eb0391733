// The whole box is in the picture, and reaches its margin on one side.

import assert from "node:assert/strict";
import { test } from "node:test";
import { framed } from "../src/map3d/framed.ts";

type Triple = [number, number, number];
const BOXES: [Triple, Triple][] = [
  [[0, 0, 0], [60, 40, 10]],
  [[-900, -10, -3], [900, 10, 40]],
  [[5, 5, 5], [6, 7, 90]],
];

for (const [low, high] of BOXES) {
  for (const aspect of [0.5, 1.3, 3.4]) {
    test(`a box of ${high.map((m, i) => m - low[i]!).join(" x ")} m at ${aspect}`, () => {
      const { target, eye } = framed(low, high, 55, aspect);
      const length = Math.hypot(...target.map((m, i) => m - eye[i]!));
      const away = target.map((m, i) => (m - eye[i]!) / length) as Triple;
      const up: Triple = [0, -away[2], away[1]]; // away looks north: no x
      const tall = Math.tan((55 * Math.PI) / 360);
      let furthest = 0;
      for (let corner = 0; corner < 8; corner++) {
        const at = low.map((m, i) => ((corner >> i) & 1 ? high[i]! : m) - eye[i]!) as Triple;
        const depth = at[1] * away[1] + at[2] * away[2];
        assert.ok(depth > 0);
        const vertical = Math.abs(at[1] * up[1] + at[2] * up[2]) / depth / tall;
        const across = Math.abs(at[0]) / depth / (tall * aspect);
        assert.ok(vertical < 1 && across < 1);
        furthest = Math.max(furthest, vertical, across);
      }
      assert.ok(furthest > 0.9);
    });
  }
}
