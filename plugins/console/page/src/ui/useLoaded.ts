// What a view loads: it begins again when what it depends on changes, and a late answer never replaces a newer one.

import { useLayoutEffect, useState } from "preact/hooks";

export interface Loaded<T> {
  value: T | null;
  error: unknown;
  again: () => void;
}

export function useLoaded<T>(load: (signal: AbortSignal) => Promise<T>, inputs: unknown[]): Loaded<T> {
  const [value, setValue] = useState<T | null>(null);
  const [error, setError] = useState<unknown>(null);
  const [round, setRound] = useState(0);
  // not after the next picture: on a slow machine that is a tenth of a second later
  useLayoutEffect(() => {
    const stop = new AbortController();
    setError(null);
    load(stop.signal)
      .then((found) => !stop.signal.aborted && setValue(() => found))
      .catch((reason: unknown) => !stop.signal.aborted && setError(reason));
    return () => stop.abort();
  }, [...inputs, round]);
  return { value, error, again: () => setRound((n) => n + 1) };
}
