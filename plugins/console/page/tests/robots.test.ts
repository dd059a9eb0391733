import assert from "node:assert/strict";
import { test } from "node:test";
import { alertsOf, robotsOf } from "../src/live/robotsOf.ts";
import type { Fix } from "../src/live/seconds.ts";

function fix(caller: string, time_s: number, isLocalized: boolean): Fix {
  const pose = isLocalized ? { position: [time_s, 0, 0], quaternion: [0, 0, 0, 1] } : null;
  const answer = { verdict: isLocalized ? "localized" : "rejected", probability: 0.9, T_map_sensor: pose } as const;
  return { number: time_s, replica: "a", time_s, caller, transport: "http", ms: 10, answer: answer as Fix["answer"] };
}

test("a robot keeps its last fix through answers without a pose", () => {
  const [robot] = robotsOf([fix("one", 1, true), fix("one", 2, false)]);
  assert.equal(robot!.last.time_s, 2);
  assert.equal(robot!.lastFix!.time_s, 1);
  assert.deepEqual([robot!.localized, robot!.answers], [1, 2]);
});

test("a silent robot and one that is seldom localized need a person", () => {
  const fixes = [fix("gone", 1, true), ...[90, 91, 92, 93, 94].map((time_s) => fix("lost", time_s, false))];
  assert.deepEqual(alertsOf(robotsOf(fixes), 100).map((one) => one.id), ["localized:lost", "silent:gone"]);
  assert.deepEqual(alertsOf(robotsOf(fixes.slice(0, 4)), 50), []);
});
