// Points as text: .xyz, .txt, .pts, and .csv with or without a line of names.

import type { Points } from "./points";

const SHOWN = 60; // characters of a line that is wrong

/** Reads x, y and z by the names of the first line, or else the first three numbers of each line. */
export function text(body: ArrayBuffer): Points {
  const lines = new TextDecoder().decode(body).split(/\r?\n/);
  const found: number[] = [];
  let columns: number[] | null = null;
  for (const [i, line] of lines.entries()) {
    const words = line.trim().split(/[\s,;]+/).filter(Boolean);
    if (!words.length || /^(#|\/\/)/.test(words[0]!)) continue;
    if (/\d,\d/.test(line) && line.includes(";")) throw new Error(`line ${i + 1} has decimal commas: write points`);
    if (columns === null) {
      columns = namedIn(words) ?? [0, 1, 2];
      if (!words.every(isNumber)) {
        if (namedIn(words)) continue;
        throw new Error(`line ${i + 1} names no columns x, y, z, and is no row of numbers: '${line.slice(0, SHOWN)}'`);
      }
      if (words.length === 1 && found.length === 0) {
        columns = null; // the number of points, as .pts begins
        continue;
      }
    }
    const row = columns.map((column) => Number(words[column] ?? NaN));
    if (!columns.every((column) => isNumber(words[column] ?? ""))) {
      throw new Error(`line ${i + 1} is not a row of three numbers: '${line.slice(0, SHOWN)}'`);
    }
    found.push(...row);
  }
  return new Float32Array(found);
}

function namedIn(words: string[]): number[] | null {
  const names = words.map((word) => word.replace(/["']/g, "").toLowerCase());
  const columns = ["x", "y", "z"].map((axis) => names.indexOf(axis));
  return columns.every((column) => column >= 0) ? columns : null;
}

function isNumber(word: string): boolean {
  return /^[-+]?(nan|inf|\d)/i.test(word) && (/nan|inf/i.test(word) || Number.isFinite(Number(word)));
}
