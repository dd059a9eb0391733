// How the console meets a service that refuses for a while: when it asks again, and when it gives up.

export const TRIES = 4; // of one read
export const MAX_WAIT_S = 30; // in which somebody still waits for a view
export const RECONNECT_MS = 1000; // browsers drop their waiting requests when the computer changes its network
const SPREAD = 0.25; // so that refused requests do not come back all at once
const AGAIN_MS = 2000; // between two tries to open a stream
const REFUSED_FOR_GOOD = [401, 403, 404];

type Pause = (ms: number, signal?: AbortSignal) => Promise<void>;

/** Ends after some time. Fails when the signal is aborted, with its reason. */
export function pause(ms: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resume, fail) => {
    signal?.throwIfAborted();
    const stop = () => {
      clearTimeout(timer);
      fail(signal!.reason as Error);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resume();
    }, ms);
    signal?.addEventListener("abort", stop, { once: true });
  });
}

/** Seconds that the service asks to wait; null if it did not refuse, or said nothing about when it will not. */
export function secondsToWait(response: Response, now = Date.now()): number | null {
  const said = response.headers.get("Retry-After");
  if (![429, 503].includes(response.status) || !said) return null;
  const seconds = /^\d+$/.test(said.trim()) ? Number(said) : (Date.parse(said) - now) / 1000;
  return Number.isNaN(seconds) ? null : Math.max(0, seconds);
}

/**
 * Sends a read, and again as long as the service asks to wait for a little. Returns the last answer. A connection
 * that breaks is tried once more.
 */
export async function patiently(
  ask: () => Promise<Response>,
  signal?: AbortSignal,
  wait: Pause = pause,
): Promise<Response> {
  let broken = 0;
  for (let tries = 1; ; tries++) {
    const response = await ask().catch((error: unknown) => {
      if (broken++ || signal?.aborted) throw error;
      return wait(RECONNECT_MS, signal).then(ask);
    });
    const seconds = secondsToWait(response);
    if (seconds === null || seconds > MAX_WAIT_S || tries === TRIES) return response;
    void response.body?.cancel();
    await wait(seconds * 1000 * (1 + SPREAD * Math.random()), signal);
  }
}

/** Reads a stream, and again when it breaks, until aborted or until the service refuses it for good. */
export async function againAndAgain(
  read: () => Promise<void>,
  signal: AbortSignal,
  failed: (error: unknown) => void,
  wait: Pause = pause,
): Promise<void> {
  try {
    while (!signal.aborted) {
      try {
        await read();
      } catch (error) {
        if (signal.aborted) return;
        failed(error);
        if (REFUSED_FOR_GOOD.includes((error as { status?: number }).status ?? 0)) return;
      }
      await wait(AGAIN_MS, signal);
    }
  } catch (error) {
    if (!signal.aborted) throw error;
  }
}
