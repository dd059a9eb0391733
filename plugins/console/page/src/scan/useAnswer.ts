// Asks where the scan was taken, and again when the options change.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Schemas } from "../api/client";
import { localize, type LocalizeQuery } from "../api/scans";
import { note, route } from "../router";
import type { Asked } from "./asked";
import { placeOf } from "./tryState";

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
  const fromLink = useRef(0); // the place that a link chose, until the first answer
  useEffect(() => {
    fromLink.current = placeOf(route.value.query.get("place"));
    if (answer.value) chosen.value = answer.value.hypotheses[fromLink.current] ? fromLink.current : 0;
  }, [route.value]);
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
        chosen.value = said.hypotheses[fromLink.current] ? fromLink.current : 0;
        fromLink.current = 0;
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
  useEffect(() => {
    if (answer.value) note({ place: chosen.value ? String(chosen.value) : "" });
  }, [answer.value, chosen.value]);
  return { answer, chosen, isAsking };
}
