// A service that refuses for a while is asked again when it says so, a few times, and one that refuses for good is not.

import assert from "node:assert/strict";
import { test } from "node:test";
import { againAndAgain, MAX_WAIT_S, patiently, pause, RECONNECT_MS, secondsToWait, TRIES } from "../src/api/patience.ts";

function answer(status: number, retryAfter?: string): () => Response {
  return () => new Response("{}", { status, headers: retryAfter ? { "Retry-After": retryAfter } : {} });
}

async function asked(...answers: (() => Response)[]): Promise<{ status: number; waits: number[]; times: number }> {
  const waits: number[] = [];
  let times = 0;
  const ask = async () => answers[Math.min(times++, answers.length - 1)]!();
  const last = await patiently(ask, undefined, async (ms) => void waits.push(ms / 1000));
  return { status: last.status, waits, times };
}

test("a read waits as long as it is told, and is sent again", async () => {
  for (const status of [429, 503]) {
    const seen = await asked(answer(status, "3"), answer(status, "7"), answer(200));
    assert.equal(seen.status, 200);
    assert.equal(seen.waits.length, 2);
    for (const [i, told] of [3, 7].entries()) assert.ok(seen.waits[i]! >= told && seen.waits[i]! <= told * 1.25);
  }
});

test("it gives up after a few times, with the service's last words", async () => {
  const seen = await asked(answer(429, "1"));
  assert.deepEqual([seen.status, seen.times, seen.waits.length], [429, TRIES, TRIES - 1]);
});

test("it does not wait where waiting does not help, or for too long", async () => {
  for (const refusal of [answer(429), answer(503), answer(401, "1"), answer(500, "1"), answer(429, `${MAX_WAIT_S + 1}`)])
    assert.equal((await asked(refusal, answer(200))).times, 1);
});

test("a time of day is a wait, too", () => {
  const now = Date.parse("2026-11-23T10:00:00Z");
  assert.equal(secondsToWait(answer(503, "Mon, 23 Nov 2026 10:00:05 GMT")(), now), 5);
  assert.equal(secondsToWait(answer(503, "Mon, 23 Nov 2026 09:00:00 GMT")(), now), 0);
  assert.equal(secondsToWait(answer(503, "soon")(), now), null);
});

function broken(): Response {
  throw new TypeError("Failed to fetch");
}

test("a connection that breaks is tried once more", async () => {
  const seen = await asked(broken, answer(200));
  assert.deepEqual(seen, { status: 200, waits: [RECONNECT_MS / 1000], times: 2 });
  await assert.rejects(asked(broken), TypeError);
  await assert.rejects(asked(broken, answer(503, "0"), broken, answer(200)), TypeError);
});

test("nobody waits for a view that is left", async () => {
  const stop = new AbortController();
  const waiting = patiently(async () => answer(429, "20")(), stop.signal, (ms, signal) => {
    queueMicrotask(() => stop.abort());
    return pause(ms, signal);
  });
  await assert.rejects(waiting, { name: "AbortError" });
  await assert.rejects(pause(1e6, stop.signal), { name: "AbortError" });
});

test("a stream is opened again until it is refused for good", async () => {
  for (const status of [401, 403, 404]) {
    const errors = [{ status: 0 }, { status: 503 }, null, { status: 429 }, { status }];
    const failures: unknown[] = [];
    let opened = 0;
    const read = async () => {
      const error = errors[opened++];
      if (error) throw error;
    };
    await againAndAgain(read, new AbortController().signal, (error) => failures.push(error), async () => {});
    assert.equal(opened, errors.length);
    assert.equal(failures.length, errors.length - 1);
  }
});

test("a stream that is not wanted any more is not opened again", async () => {
  const stop = new AbortController();
  let opened = 0;
  await againAndAgain(async () => void opened++, stop.signal, assert.fail, async (ms, signal) => {
    stop.abort();
    await pause(ms, signal);
  });
  assert.equal(opened, 1);
});
