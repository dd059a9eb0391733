import assert from "node:assert/strict";
import { test } from "node:test";
import { ellipseOf } from "../src/scan/ellipse.ts";

function covariance(xx: number, xy: number, yy: number): number[] {
  const found = new Array<number>(36).fill(0);
  [found[0], found[1], found[6], found[7]] = [xx, xy, xy, yy];
  return found;
}

test("an ellipse lies along the direction that is known least", () => {
  const along = ellipseOf(covariance(0.04, 0, 0.01));
  assert.ok(Math.abs(along.major_m - 0.2 * Math.sqrt(5.991)) < 1e-9);
  assert.ok(Math.abs(along.minor_m - 0.1 * Math.sqrt(5.991)) < 1e-9);
  assert.equal(along.angle_rad, 0);
  const slanted = ellipseOf(covariance(0.02, 0.01, 0.02));
  assert.ok(Math.abs(slanted.angle_rad - Math.PI / 4) < 1e-9);
});
