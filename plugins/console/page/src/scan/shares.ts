// The places of an answer as they are listed: the likeliest first, with probabilities that add up.

import type { Schemas } from "../api/client";

export interface Place {
  number: number; // of the hypothesis in the answer
  probability: number;
}

type Answer = Pick<Schemas["Answer"], "hypotheses" | "probability">;

/**
 * An answer gives each place behind the best ones as much as it can have at most, which may be more than is left for all.
 * Here they share what is left.
 */
export function placesOf(answer: Answer): Place[] {
  const { hypotheses, probability } = answer;
  const tied = sharersOf(answer);
  const others = hypotheses.slice(tied).reduce((sum, one) => sum + one.probability, 0);
  const share = Math.min(1, Math.max(0, 1 - probability) / (others || 1));
  return hypotheses
    .map((one, number) => ({ number, probability: number < tied ? one.probability : one.probability * share }))
    .sort((a, b) => b.probability - a.probability || a.number - b.number);
}

/** How many places the answer's probability is shared among: one, or those that tie. */
export function sharersOf({ hypotheses, probability }: Answer): number {
  return tiedOf(hypotheses.map((one) => one.probability), probability);
}

function tiedOf(probabilities: number[], all: number): number {
  const best = probabilities[0];
  if (!best) return Math.min(1, probabilities.length);
  const equal = probabilities.findIndex((one) => one !== best);
  const most = equal < 0 ? probabilities.length : equal;
  return Math.max(1, Math.min(most, Math.round(all / best)));
}
