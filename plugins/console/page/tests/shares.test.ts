import assert from "node:assert/strict";
import { test } from "node:test";
import { placesOf, sharersOf } from "../src/scan/shares.ts";
import { chance, chances } from "../src/ui/text.ts";

const LEVEL = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };

function answer(probability: number, ...each: number[]) {
  const hypotheses = each.map((one) => ({ probability: one, T_map_sensor: LEVEL }));
  return { probability, hypotheses } as unknown as Parameters<typeof placesOf>[0];
}

test("places share what the best one leaves, and the likeliest comes first", () => {
  const shares = placesOf(answer(0.988, 0.988, ...Array<number>(7).fill(0.012))).map((one) => one.probability);
  assert.equal(shares[0], 0.988);
  assert.ok(Math.abs(shares.reduce((a, b) => a + b) - 1) < 1e-9);

  const numbers = placesOf(answer(0.287, 0.287, 0.001, 0.005, 0, 0.001)).map((one) => one.number);
  assert.deepEqual(numbers, [0, 2, 1, 4, 3]);
});

test("places that tie share the answer's probability", () => {
  const shares = placesOf(answer(0.9, 0.45, 0.45, 0.1, 0.1)).map((one) => one.probability);
  assert.deepEqual(shares.slice(0, 2), [0.45, 0.45]);
  assert.ok(Math.abs(shares[2]! + shares[3]! - 0.1) < 1e-9);
  assert.deepEqual(placesOf(answer(0)), []);
  assert.equal(sharersOf(answer(0.9, 0.45, 0.45, 0.1, 0.1)), 2);
  assert.equal(sharersOf(answer(0.988, 0.988, 0.012)), 1);
});

test("what is not certain is not called 100 %, and two numbers that are compared differ", () => {
  assert.deepEqual([0, 0.0001, 0.5, 0.9949, 0.9996, 0.99998, 0.99999999, 1].map((one) => chance(one)), [
    "0.0 %", "under 0.1 %", "50.0 %", "99.5 %", "99.96 %", "99.998 %", "over 99.9999 %", "100.0 %",
  ]);
  assert.deepEqual(chances(0.9949, 0.995), ["99.49 %", "99.50 %"]);
  assert.deepEqual(chances(0.99998, 1), ["99.998 %", "100.0 %"]);
});
