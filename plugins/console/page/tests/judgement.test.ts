import assert from "node:assert/strict";
import { test } from "node:test";
import { judgementOf } from "../src/recorded/judgement.ts";
import type { RecordedQuery } from "../src/recorded/place.ts";

const LEVEL = [0, 0, 0, 1];
const TURNED = [0, 0, Math.SQRT1_2, Math.SQRT1_2]; // by 90 degrees

function pose(x: number, quaternion = LEVEL) {
  return { position: [x, 0, 0], quaternion };
}

function kind(verdict: string, truth: RecordedQuery["truth"], map_id = "yard"): string | undefined {
  const answer = { verdict, map_id, T_map_sensor: verdict === "localized" ? pose(0) : null };
  type Given = Parameters<typeof judgementOf>;
  return judgementOf({ map_id, truth } as Given[0], answer as Given[1], "yard")?.kind;
}

test("a localized answer is false where it is off, or the scan was taken elsewhere", () => {
  assert.equal(kind("localized", { map_id: "yard", T_map_sensor: pose(0.9) }), undefined);
  assert.equal(kind("localized", { map_id: "yard", T_map_sensor: pose(1.1) }), "false");
  assert.equal(kind("localized", { map_id: "yard", T_map_sensor: pose(0, TURNED) }), "false");
  assert.equal(kind("localized", { map_id: "yard", T_map_sensor: null }), "false");
  assert.equal(kind("localized", { map_id: "hall", T_map_sensor: pose(0) }), "false");
  assert.equal(kind("localized", { map_id: "hall", T_map_sensor: pose(9) }, "hall"), undefined, "of another map");
  assert.equal(kind("localized", null), undefined);
});

test("only an answer that rejects a scan of this map is disputed", () => {
  assert.equal(kind("rejected", { map_id: "yard", T_map_sensor: pose(0) }), "disputed");
  assert.equal(kind("rejected", { map_id: "yard", T_map_sensor: null }), undefined);
  assert.equal(kind("rejected", { map_id: "hall", T_map_sensor: pose(0) }), undefined);
  assert.equal(kind("ambiguous", { map_id: "yard", T_map_sensor: pose(0) }), undefined);
});
