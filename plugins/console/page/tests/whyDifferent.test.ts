import assert from "node:assert/strict";
import { test } from "node:test";
import { whyDifferent } from "../src/versions/whyDifferent.ts";

const version = (file_name: string, sha256: string, min_probability: number, found: number) =>
  ({
    provenance: { file_name, sha256, trajectory: "", release: "0.1.0", note: "", size_bytes: 0 },
    summary: { sensor: "os0-64", size_m: [35, 62, 11], found, threshold: { min_probability, max_false_accept: 0.01 } },
  }) as never;

test("other files and other thresholds are told, and which of them decides", () => {
  const [source, threshold] = whyDifferent(version("map_0.05m.laz", "a", 0.99, 0.97), version("map_0.1m.pcd", "b", 0.9, 0.96));
  assert.equal(source, "They were made of other files: map_0.05m.laz and map_0.1m.pcd.");
  assert.match(threshold!, /from 99 %, the second from 90 %.*Both know as many places \(97 % and 96 %\): the threshold makes the difference/);
});

test("two builds of one file say so", () => {
  assert.match(whyDifferent(version("a.ply", "a", 0.9, 0.9), version("b.ply", "a", 0.9, 0.8)).join(), /same file, for the same sensor/);
});

test("the same name with another content, and an unknown source", () => {
  assert.deepEqual(whyDifferent(version("a.ply", "a", 0.9, 0.9), version("a.ply", "b", 0.9, 0.9)), ["Both were made of a file a.ply, with another content."]);
  assert.match(whyDifferent(version("", "", 0.9, 0.9), version("a.ply", "b", 0.9, 0.9)).join(), /earlier release built it/);
});
