// What a view loads again and again while somebody looks at it.

import { useEffect } from "preact/hooks";
import { type Loaded, useLoaded } from "./useLoaded";

/** As `useLoaded`, and anew each `period_ms` while the page is in sight. A failure later on leaves the last value. */
export function usePolled<T>(load: (signal: AbortSignal) => Promise<T>, inputs: unknown[], period_ms: number): Loaded<T> {
  const loaded = useLoaded(load, inputs);
  const { again } = loaded;
  useEffect(() => {
    const clock = setInterval(() => !document.hidden && again(), period_ms);
    return () => clearInterval(clock);
  }, [period_ms]);
  return loaded;
}
