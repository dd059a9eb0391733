import assert from "node:assert/strict";
import { test } from "node:test";
import { seenWith, type SeenStage, timesOfStages } from "../src/maps/stageTimes.ts";

const record = (stage: string, state = "running") => ({ stage, state }) as never;

test("a stage lasts from its first record to that of the next one", () => {
  let seen: SeenStage[] = [];
  for (const [stage, at] of [["read_map", 0], ["read_map", 1000], ["make_templates", 5000], ["self_test", 9000]] as const) {
    seen = seenWith(seen, record(stage), at);
  }
  assert.deepEqual(timesOfStages(seen, 10_000), [
    { stage: "read_map", seconds: null, isGoing: false }, // it may have begun before the page was opened
    { stage: "make_templates", seconds: 4, isGoing: false },
    { stage: "self_test", seconds: 1, isGoing: true },
  ]);
});

test("a build that waits has no stage yet", () => {
  assert.deepEqual(seenWith([], record("", "queued"), 0), []);
});
