import assert from "node:assert/strict";
import { test } from "node:test";
import { whyItWaits } from "../src/maps/buildRecords.ts";

const record = (build_id: string, map_id: string, state: string, more: object = {}) => ({ build_id, map_id, state, ...more }) as never;

test("a build that waits says for what", () => {
  const others = [record("a", "hall", "running"), record("b", "yard", "queued"), record("c", "old", "succeeded"), record("e", "later", "queued")];
  assert.equal(whyItWaits(record("d", "office", "queued"), others), "It waits for its turn, behind 2 builds of hall, yard.");
  assert.equal(whyItWaits(record("d", "office", "queued"), others.slice(0, 1)), "It waits for its turn, behind the build of hall.");
  assert.equal(whyItWaits(record("d", "office", "queued"), []), "It waits for its turn.");
});

test("what the service says of a build that waits comes first", () => {
  const told = record("d", "office", "queued", { waits_for: "no builder runs", error: { code: "x", detail: "the store is gone" } });
  assert.equal(whyItWaits(told, []), "It waits: no builder runs.");
  const again = record("d", "office", "queued", { error: { code: "x", detail: "the store is gone" } });
  assert.equal(whyItWaits(again, []), "It is tried again, because of this: the store is gone");
});

test("a build that runs or has ended waits for nothing", () => {
  for (const state of ["running", "succeeded", "failed", "cancelled"]) assert.equal(whyItWaits(record("d", "office", state), []), "");
});
