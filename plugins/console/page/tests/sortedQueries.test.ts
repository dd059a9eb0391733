import assert from "node:assert/strict";
import { test } from "node:test";
import { clicked, NEWEST, sorted } from "../src/recorded/sorted.ts";

const queries = [
  { time: "2026-11-30T10:00:00.5Z", map_id: "yard", body_bytes: 900, answer: { verdict: "rejected", probability: 0.1 }, truth: null },
  { time: "2026-11-30T10:00:00Z", map_id: "hall", body_bytes: 10_000, answer: { verdict: "localized", probability: 1 }, truth: { T_map_sensor: null } },
  { time: "2026-11-29T23:00:00Z", map_id: "shed", body_bytes: 3000, answer: { verdict: "ambiguous", probability: 0.6 }, truth: null },
] as never[];
const maps = (order: Parameters<typeof sorted>[1]) => sorted(queries, order).map((one: { map_id: string }) => one.map_id);

test("recorded queries are sorted by each column, and what nobody judged stands last", () => {
  assert.deepEqual(maps(NEWEST), ["yard", "hall", "shed"]);
  assert.deepEqual(maps({ column: "size", isDown: true }), ["hall", "shed", "yard"]);
  assert.deepEqual(maps({ column: "probability", isDown: false }), ["yard", "shed", "hall"]);
  assert.deepEqual(maps({ column: "verdict", isDown: false }), ["shed", "hall", "yard"]);
  for (const isDown of [true, false]) assert.equal(maps({ column: "truth", isDown })[0], "hall");
});

test("a second click on a head turns the order round", () => {
  const bySize = clicked(NEWEST, "size");
  assert.deepEqual(bySize, { column: "size", isDown: true });
  assert.deepEqual(clicked(bySize, "size"), { column: "size", isDown: false });
  assert.deepEqual(clicked(bySize, "map"), { column: "map", isDown: false });
});
