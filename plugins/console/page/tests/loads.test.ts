// Requests for nodes: the first wanted first, few at a time, neighbours together, and those ended that nobody needs.

import assert from "node:assert/strict";
import { test } from "node:test";
import { type Kept, Loads, toFree, type Wanted } from "../src/map3d/loads.ts";

class Server {
  readonly begun: string[] = [];
  readonly ended: string[] = [];
  readonly arrived: string[] = [];
  readonly problems: unknown[] = [];
  private readonly answers = new Map<string, { give: (data: string[]) => void; refuse: (error: unknown) => void }>();
  readonly loads = new Loads<Wanted, string>(
    (run, signal) => {
      const key = run.map((one) => one.key).join("");
      this.begun.push(key);
      return new Promise((give, refuse) => {
        this.answers.set(key, { give, refuse });
        signal.addEventListener("abort", () => {
          this.ended.push(key);
          refuse(signal.reason);
        });
      });
    },
    ({ key }, data) => {
      assert.equal(data, key, "each node gets its own");
      this.arrived.push(key);
    },
    (error) => this.problems.push(error),
    2,
  );

  /** Wants nodes named by letters, which are far from each other in the file. */
  want(keys: string): void {
    this.wantNodes([...keys].map((key) => ({ key, first: 10 * key.charCodeAt(0), count: 9 })));
  }

  wantNodes(nodes: Wanted[]): void {
    this.loads.want(nodes, (key) => this.arrived.includes(key));
  }

  async answer(key: string, error?: unknown): Promise<void> {
    const { give, refuse } = this.answers.get(key)!;
    if (error) refuse(error);
    else give([...key]);
    await new Promise((resume) => setImmediate(resume));
  }
}

test("the first are asked for first, and no more than allowed at a time", async () => {
  const server = new Server();
  server.want("abcd");
  assert.deepEqual(server.begun, ["a", "b"]);
  server.want("abcd");
  assert.deepEqual(server.begun, ["a", "b"]);
  await server.answer("b");
  server.want("abcd");
  assert.deepEqual(server.begun, ["a", "b", "c"]);
});

test("a request that nobody needs is ended, and its place is free at once", async () => {
  const server = new Server();
  server.want("ab");
  server.want("bcd");
  assert.deepEqual(server.ended, ["a"]);
  assert.deepEqual(server.loads.keys, ["b", "c"]);
  await server.answer("a"); // too late: it counts for nothing
  assert.deepEqual(server.arrived, []);
  assert.deepEqual(server.problems, []);
});

test("a node that is wanted again is asked for again", async () => {
  const server = new Server();
  server.want("a");
  server.want("b");
  server.want("ab");
  assert.deepEqual(server.begun, ["a", "b", "a"]);
  await server.answer("a");
  assert.deepEqual(server.arrived, ["a"]);
  assert.deepEqual(server.loads.keys, ["b"]);
});

test("nodes that follow each other in the file come together, up to a size", async () => {
  const server = new Server();
  const nodes = [
    { key: "c", first: 60_000, count: 30_000 },
    { key: "a", first: 0, count: 50_000 },
    { key: "b", first: 50_000, count: 10_000 },
    { key: "d", first: 90_000, count: 40_000 },
    { key: "e", first: 500_000, count: 900_000 },
  ];
  server.wantNodes(nodes);
  assert.deepEqual(server.begun, ["cd", "ab"]);
  assert.deepEqual(server.loads.keys, ["c", "d", "a", "b"]);
  server.wantNodes(nodes.filter(({ key }) => key === "b" || key === "e"));
  assert.deepEqual(server.ended, ["cd"], "a request goes on while one of its nodes is needed");
  assert.deepEqual(server.begun, ["cd", "ab", "e"]);
  await server.answer("ab");
  assert.deepEqual(server.arrived, ["a", "b"]);
});

test("a failure is told, and what is ended tells nothing", async () => {
  const server = new Server();
  server.want("ab");
  await server.answer("a", new Error("gone"));
  server.loads.end();
  await new Promise((resume) => setImmediate(resume));
  assert.deepEqual(server.problems.map(String), ["Error: gone"]);
  assert.deepEqual(server.loads.keys, []);
});

test("the longest unused are freed first, and never what is drawn", () => {
  const kept = new Map<string, Kept>([
    ["drawn", { count: 50, used: 9 }],
    ["older", { count: 30, used: 2 }],
    ["newer", { count: 30, used: 7 }],
  ]);
  assert.deepEqual(toFree(kept, 9, 110), []);
  assert.deepEqual(toFree(kept, 9, 100), ["older"]);
  assert.deepEqual(toFree(kept, 9, 60), ["older", "newer"]);
  assert.deepEqual(toFree(kept, 9, 10), ["older", "newer"]);
});
