// A pose by hand as quaternion, angles and options.

import assert from "node:assert/strict";
import { test } from "node:test";
import { gravityOf, type HandPose, handPoseAt, handPoseOf, poseOf, priorOf } from "../src/scan/handPose.ts";

const HAND: HandPose = {
  position: [1, -2, 0.5],
  roll_deg: 10,
  pitch_deg: -20,
  yaw_deg: 130,
  radius_m: 3,
  yaw_range_deg: 180,
};

test("angles come back from the quaternion", () => {
  const again = handPoseOf(poseOf(HAND), HAND);
  for (const [name, value] of Object.entries(HAND)) {
    if (typeof value === "number") assert.ok(Math.abs(again[name as "roll_deg"] - value) < 1e-9, name);
  }
});

test("the quaternion of a turn about one axis is the known one", () => {
  const level = handPoseAt([0, 0, 0], null);
  const half = Math.SQRT1_2;
  const turns: [Partial<HandPose>, number[]][] = [
    [{ roll_deg: 90 }, [half, 0, 0, half]],
    [{ pitch_deg: 90 }, [0, half, 0, half]],
    [{ yaw_deg: 90 }, [0, 0, half, half]],
  ];
  for (const [turn, expected] of turns) {
    const { quaternion } = poseOf({ ...level, ...turn });
    quaternion.forEach((part, i) => assert.ok(Math.abs(part - expected[i]!) < 1e-12));
  }
});

test("the prior has a heading only where it is known", () => {
  assert.equal(priorOf(HAND), "1.000,-2.000,0.500,3");
  assert.equal(priorOf({ ...HAND, yaw_range_deg: 30 }), "1.000,-2.000,0.500,3,130,30");
  assert.equal(gravityOf(HAND), "10,-20");
});
