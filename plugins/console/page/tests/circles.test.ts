// No two modules of the page import each other, not even for a type, and none does so through others.

import assert from "node:assert/strict";
import { existsSync, globSync, readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { test } from "node:test";

const NAMED = /\b(?:from|import)\s*\(?"(\.[^"]+)"/g;

test("no module imports itself through others", () => {
  const files = globSync("src/**/*.{ts,tsx}").filter((file) => !file.endsWith(".d.ts"));
  assert.ok(files.length > 50);
  const done = new Set<string>();
  const visit = (file: string, way: string[]) => {
    assert.ok(!way.includes(file), [...way.slice(way.indexOf(file)), file].join(" -> "));
    if (done.has(file)) return;
    for (const [, name] of readFileSync(file, "utf8").matchAll(NAMED)) {
      const target = ["", ".ts", ".tsx"].map((suffix) => join(dirname(file), name + suffix)).find(isModule);
      if (target) visit(target, [...way, file]);
    }
    done.add(file);
  };
  const isModule = (path: string) => /\.tsx?$/.test(path) && existsSync(path);
  files.forEach((file) => visit(file, []));
});
