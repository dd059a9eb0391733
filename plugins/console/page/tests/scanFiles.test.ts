import assert from "node:assert/strict";
import { test } from "node:test";
import { npy } from "../src/scan/formats/npy.ts";
import { text } from "../src/scan/formats/text.ts";

const read = (said: string) => [...text(new TextEncoder().encode(said).buffer as ArrayBuffer)];

test("text is read by its names or else its first three columns", () => {
  assert.deepEqual(read("# a comment\n1 2 3 9\n4,5,6\n"), [1, 2, 3, 4, 5, 6]);
  assert.deepEqual(read("intensity;Y;X;Z\n9;2;1;3\n"), [1, 2, 3]);
  assert.deepEqual(read("2\n1 2 3\n4 5 6\n"), [1, 2, 3, 4, 5, 6]); // .pts begins with its number
  assert.throws(() => read("1 2 3\n4 five 6\n"), /line 2 is not a row of three numbers: '4 five 6'/);
  assert.throws(() => read("1,5;2,5;3,5\n"), /decimal commas/);
  assert.throws(() => read("a b c\n"), /no columns x, y, z/);
});

test("an array of another shape or kind is refused in words", () => {
  const file = (head: string, numbers: number[]) => {
    const header = new TextEncoder().encode(head);
    const body = new Uint8Array(10 + header.length + 4 * numbers.length);
    body.set([0x93, ...new TextEncoder().encode("NUMPY"), 1, 0, header.length & 255, header.length >> 8]);
    body.set(header, 10);
    body.set(new Uint8Array(new Float32Array(numbers).buffer), 10 + header.length);
    return body.buffer as ArrayBuffer;
  };
  const head = (shape: string, kind = "<f4", order = "False") =>
    `{'descr': '${kind}', 'fortran_order': ${order}, 'shape': (${shape}), }\n`;
  assert.deepEqual([...npy(file(head("2, 3"), [1, 2, 3, 4, 5, 6]))], [1, 2, 3, 4, 5, 6]);
  assert.deepEqual([...npy(file(head("2, 3", "<f4", "True"), [1, 4, 2, 5, 3, 6]))], [1, 2, 3, 4, 5, 6]);
  assert.throws(() => npy(file(head("3, 77093"), [])), /\(3, 77093\): scans are \(n, 3\), so transpose it/);
  assert.throws(() => npy(file(head("6,"), [1])), /\(6\)/);
  assert.throws(() => npy(file(head("9, 3"), [1])), /cut off/);
  assert.throws(() => npy(file(head("2, 3", "|O"), [1])), /not float32 or float64/);
});
