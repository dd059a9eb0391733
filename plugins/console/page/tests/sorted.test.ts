import assert from "node:assert/strict";
import { test } from "node:test";
import { sorted } from "../src/maps/sorted.ts";

const maps = [
  { map_id: "hall", localized: 0.9, size_m: [10, 10, 3] },
  { map_id: "yard", localized: null, size_m: [30, 2, 3] },
  { map_id: "hall-2", localized: 0.5, size_m: null },
].map(({ map_id, ...summary }) => ({ map_id, active_version: null, published_time: null, provisional: false, summary })) as never[];
const names = (words: string, column: "map" | "localized" | "size", isDown: boolean) =>
  sorted(maps, new Map(), words, { column, isDown }).map((one) => one.map_id);

test("maps are sorted by what they have, and those without it stand last either way", () => {
  assert.deepEqual(names("", "map", true), ["yard", "hall-2", "hall"]);
  assert.deepEqual(names("", "localized", true), ["hall", "hall-2", "yard"]);
  assert.deepEqual(names("", "localized", false), ["hall-2", "hall", "yard"]);
  assert.deepEqual(names("", "size", false), ["yard", "hall", "hall-2"]);
});

test("maps are found by a part of their names", () => {
  assert.deepEqual(names(" HALL", "map", false), ["hall", "hall-2"]);
  assert.deepEqual(names("none", "map", false), []);
});
