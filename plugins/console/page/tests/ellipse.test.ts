import assert from "node:assert/strict";
import { test } from "node:test";
import { deviationsOf, ellipseOf } from "../src/scan/ellipse.ts";

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

test("the deviations are those of the diagonal, the heading's in degrees", () => {
  const given = covariance(0.04, 0.01, 0.01);
  [given[14], given[35]] = [0.0001, (Math.PI / 180) ** 2];
  const { x_m, y_m, z_m, heading_deg } = deviationsOf(given);
  [x_m - 0.2, y_m - 0.1, z_m - 0.01, heading_deg - 1].forEach((away) => assert.ok(Math.abs(away) < 1e-9));
});
