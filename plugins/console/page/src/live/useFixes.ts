// The last answers about a map, followed as they are given, through breaks and restarts of the service.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Problem } from "../api/client";
import { follow } from "../api/events";
import { answerEvents } from "../api/scans";
import type { Fix } from "./seconds";

const KEPT = 500;

interface Watching {
  replica: string;
  all_replicas: boolean;
}

export interface FixesState {
  fixes: Signal<Fix[]>;
  source: Signal<Watching | null>; // which replicas are heard
  isConnected: Signal<boolean>;
  trouble: Signal<string>; // why it is not connected; "": nobody knows
  problem: Signal<unknown>; // that ends it
}

export function useFixes(map: string): FixesState {
  const fixes = useSignal<Fix[]>([]);
  const source = useSignal<Watching | null>(null);
  const isConnected = useSignal(false);
  const trouble = useSignal("");
  const problem = useSignal<unknown>(null);
  useEffect(() => {
    if (!map) return;
    const stop = new AbortController();
    fixes.value = [];
    let last = 0;
    void follow(
      () => answerEvents({ map_id: map, after: last }, stop.signal),
      (event) => {
        isConnected.value = true;
        trouble.value = "";
        if (event.name === "watching") {
          const { replica, all_replicas } = event.data as Watching;
          // another replica, or the same one started again, counts from one
          if (replica !== source.value?.replica) last = 0;
          source.value = { replica, all_replicas };
          return;
        }
        const fix = event.data as Fix;
        last = fix.number;
        if (!fixes.value.some((one) => isSame(one, fix))) fixes.value = [...fixes.value, fix].slice(-KEPT);
      },
      stop.signal,
      (error) => {
        isConnected.value = false;
        last = 0;
        if (error instanceof Problem && error.status === 403) problem.value = error;
        trouble.value = error instanceof Problem ? error.message : "";
      },
    );
    isConnected.value = true;
    return () => stop.abort();
  }, [map]);
  return { fixes, source, isConnected, trouble, problem };
}

/** Whether both tell of one answer: after a break it may come once more, with another number. */
function isSame(a: Fix, b: Fix): boolean {
  return a.time_s === b.time_s && a.replica === b.replica && a.caller === b.caller && a.robot === b.robot;
}
