// How long each stage of a build takes, as far as the page has seen it run.

import type { Schemas } from "../api/client";

type Build = Schemas["Build"];

export interface SeenStage {
  stage: string;
  begun_ms: number | null; // null: it ran already when the page looked first
}

/** The stages seen so far, with that of a record that has come now. */
export function seenWith(seen: readonly SeenStage[], { stage, state }: Build, now_ms: number): SeenStage[] {
  if (state !== "running" || !stage || seen.at(-1)?.stage === stage) return [...seen];
  return [...seen, { stage, begun_ms: seen.length ? now_ms : null }];
}

export interface StageTime {
  stage: string;
  seconds: number | null; // null: nobody saw it begin
  isGoing: boolean;
}

export function timesOfStages(seen: readonly SeenStage[], now_ms: number): StageTime[] {
  return seen.map(({ stage, begun_ms }, i) => {
    const end_ms = seen[i + 1]?.begun_ms ?? now_ms;
    return { stage, seconds: begun_ms === null ? null : (end_ms - begun_ms) / 1000, isGoing: i === seen.length - 1 };
  });
}
