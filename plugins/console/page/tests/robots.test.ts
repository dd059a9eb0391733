import assert from "node:assert/strict";
import { test } from "node:test";
import { alertsOf, robotsOf } from "../src/live/robotsOf.ts";
import type { Fix } from "../src/live/seconds.ts";

function fix(caller: string, time_s: number, isLocalized: boolean, robot = ""): Fix {
  const pose = isLocalized ? { position: [time_s, 0, 0], quaternion: [0, 0, 0, 1] } : null;
  const answer = { verdict: isLocalized ? "localized" : "rejected", probability: 0.9, T_map_sensor: pose } as const;
  return { number: time_s, replica: "a", time_s, caller, robot, transport: "http", ms: 10, answer: answer as Fix["answer"] };
}

test("a robot keeps its last fix through answers without a pose", () => {
  const [robot] = robotsOf([fix("one", 1, true), fix("one", 2, false)]);
  assert.equal(robot!.last.time_s, 2);
  assert.equal(robot!.lastFix!.time_s, 1);
  assert.deepEqual([robot!.localized, robot!.answers], [1, 2]);
});

test("robots behind one address are told apart by their names", () => {
  const fixes = [fix("address:10.0.0.9", 1, true, "/cart1"), fix("address:10.0.0.9", 2, true, "/cart2"), fix("key:a", 3, true, "/cart1")];
  assert.deepEqual(robotsOf(fixes).map(({ name, caller }) => [name, caller]), [
    ["/cart1", "key:a"],
    ["/cart2", "address:10.0.0.9"],
    ["/cart1", "address:10.0.0.9"],
  ]);
  assert.equal(robotsOf([fix("address:10.0.0.9", 1, true)])[0]!.name, "address:10.0.0.9");
});

test("a robot that has its fix may rest", () => {
  const rests = [fix("a", 1, false), fix("a", 2, true)];
  assert.deepEqual(alertsOf(robotsOf(rests), 86_400), []);
});

test("a robot that falls silent without a fix and one that is seldom localized need a person", () => {
  const fixes = [fix("gone", 1, false), ...[90, 91, 92, 93, 94].map((time_s) => fix("lost", time_s, false))];
  assert.deepEqual(alertsOf(robotsOf(fixes), 100).map((one) => one.id), ["localized:lost", "silent:gone"]);
  assert.deepEqual(alertsOf(robotsOf(fixes.slice(0, 4)), 50), []);
});
