import assert from "node:assert/strict";
import { test } from "node:test";
import type { HandPose } from "../src/scan/handPose.ts";
import { handOf, handText, placeOf, spotOf, spotText, usesOf } from "../src/scan/tryState.ts";

const HAND: HandPose = {
  position: [1.5, -2.25, 0.125],
  roll_deg: 1,
  pitch_deg: -2,
  yaw_deg: 170.5,
  radius_m: 5,
  yaw_range_deg: 180,
};

test("a pose by hand comes back from its text", () => {
  assert.deepEqual(handOf(handText(HAND)), HAND);
  assert.equal(handText(null), "");
});

test("texts that are no pose by hand are none", () => {
  const wrong = [null, "", "1,2,3", "1,2,3,0,0,0,5,x", "1,2,3,0,0,0,,180", "1,2,3,0,0,0,0,180", "1,2,3,0,0,0,5,181", "1,2,3,0,0,0,5,Infinity"];
  for (const text of wrong) assert.equal(handOf(text), null, String(text));
});

test("a spot has three numbers", () => {
  assert.deepEqual(spotOf(spotText([1, -2.5, 0.1234])), [1, -2.5, 0.123]);
  for (const text of [null, "", "1,2", "1,2,3,4", "1,2,NaN", "1,,3"]) assert.equal(spotOf(text), null, String(text));
});

test("what is not known of a link is left out", () => {
  assert.deepEqual(usesOf("overlay,prior,other"), ["prior", "overlay"]);
  assert.deepEqual(usesOf(null), []);
  assert.deepEqual(["3", "-1", "1e9", "", null].map(placeOf), [3, 0, 0, 0, 0]);
});
