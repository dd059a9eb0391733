// Asks where the scan was taken, and again when the options change.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Schemas } from "../api/client";
import { localize, type LocalizeQuery } from "../api/scans";
import type { Asked } from "./scanFile";

export interface AnswerState {
  answer: Signal<Schemas["Answer"] | null>;
  chosen: Signal<number>; // of its hypotheses
  isAsking: Signal<boolean>;
}

/** The answer is always one about `query`: it goes when another scan comes, and when the scan cannot be answered. */
export function useAnswer(map: string, query: Asked | null, options: LocalizeQuery, problem: Signal<unknown>): AnswerState {
  const answer = useSignal<Schemas["Answer"] | null>(null);
  const chosen = useSignal(0);
  const isAsking = useSignal(false);
  const answered = useRef<Asked | null>(null);
  useEffect(() => {
    if (answered.current !== query) answer.value = null;
    answered.current = query;
    isAsking.value = query !== null;
    if (!query) return;
    const stop = new AbortController();
    problem.value = null;
    localize(query, { map, ...options }, stop.signal)
      .then((said) => {
        if (stop.signal.aborted) return;
        answer.value = said;
        chosen.value = 0;
      })
      .catch((error: unknown) => {
        if (stop.signal.aborted) return;
        answer.value = null;
        problem.value = error;
      })
      .finally(() => {
        if (!stop.signal.aborted) isAsking.value = false;
      });
    return () => stop.abort();
  }, [query, ...Object.values(options)]);
  return { answer, chosen, isAsking };
}
