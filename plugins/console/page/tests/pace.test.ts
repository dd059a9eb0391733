// A slow machine draws fewer points while the camera moves, a quick one all of them, and each of them all at rest.

import assert from "node:assert/strict";
import { test } from "node:test";
import { COARSE, FIRST_POINTS, MIN_POINTS, Pace } from "../src/map3d/pace.ts";

const WHOLE = 1_500_000;

/** The most points of each frame of a movement, on a machine that draws so many points in a millisecond. */
function movement(pace: Pace, pointsEachMs: number, frames: number, least_ms = 16): number[] {
  const most: number[] = [];
  for (let i = 0, now_ms = 5000; i < frames; i++) {
    const points = pace.begin(now_ms, true);
    pace.drew(points);
    most.push(points);
    now_ms += Math.max(least_ms, points / pointsEachMs);
  }
  return most;
}

test("a quick machine soon draws all points in each frame", () => {
  const pace = new Pace(WHOLE);
  const most = movement(pace, 1e6, 50);
  assert.deepEqual(new Set(most.slice(8)), new Set([WHOLE]));
  assert.deepEqual(new Set(movement(pace, 1e6, 50)), new Set([WHOLE]), "the next movement does at once");
  assert.deepEqual(new Set(movement(new Pace(90_000), 1e6, 9)), new Set([90_000]), "a small map always");
});

test("a slow machine draws fewer from the second frame on, until frames come fast enough", () => {
  const pace = new Pace(WHOLE);
  const [first, ...others] = movement(pace, 3000, 20);
  assert.equal(first, FIRST_POINTS);
  for (const most of others) assert.ok(most / 3000 <= 67 && most > MIN_POINTS, String(most));
  assert.ok(pace.isReduced);
});

test("the next movement begins with what the last one learned, and a picture at rest is whole", () => {
  const pace = new Pace(WHOLE);
  const last = movement(pace, 3000, 20).at(-1);
  assert.equal(pace.begin(90_000, false), WHOLE);
  pace.drew(WHOLE);
  assert.equal(pace.begin(99_000, true), last, "the rest before it was no slow frame");
});

test("however slow the machine, a movement shows the map", () => {
  assert.equal(movement(new Pace(WHOLE), 1, 10).at(-1), MIN_POINTS);
});

test("points come back when frames become quick again", () => {
  const pace = new Pace(WHOLE);
  movement(pace, 3000, 10);
  assert.equal(movement(pace, 1e6, 30).at(-1), WHOLE);
  assert.ok(!pace.isReduced);
});

test("where the fewest points are too slow, the picture has fewer pixels until it rests", () => {
  const pace = new Pace(WHOLE);
  const pictures: number[] = [];
  for (let i = 0, now_ms = 0; i < 12; i++) {
    pace.drew(pace.begin(now_ms, true));
    pictures.push(pace.sharpness);
    now_ms += 110 * pace.sharpness ** 2; // as long as its pixels take
  }
  assert.equal(pictures[0], 1);
  assert.deepEqual(new Set(pictures.slice(8)), new Set([COARSE]));
  assert.ok(pace.isReduced);
  pace.begin(9000, false);
  assert.equal(pace.sharpness, 1);
});

test("a machine that is slow by its points alone keeps its pixels", () => {
  const pace = new Pace(WHOLE);
  movement(pace, 3000, 20);
  assert.equal(pace.sharpness, 1);
});

test("a map that has fewer points than may be drawn gets fewer pixels where frames are slow", () => {
  const pace = new Pace(WHOLE);
  for (let i = 0; i < 3; i++) {
    pace.begin(200 * i, true);
    pace.drew(10_000);
  }
  assert.equal(pace.sharpness, COARSE);
});
