// Why an answer has its verdict, in one sentence each, with the numbers that decided.

import type { Schemas } from "../api/client";
import { chance, chances, percent, reason } from "../ui/text";
import { sharersOf } from "./shares";

type Answer = Schemas["Answer"];

/** `least`: the probability that was asked for; null: not known any more. */
export function whyOf(answer: Answer, least: number | null): string[] {
  if (answer.verdict === "localized") {
    const asked = least === null ? "" : `, and ${chance(least)} is asked for`;
    return [`It is ${chance(answer.probability)} sure${asked}.`];
  }
  return answer.reasons.map((code) => {
    const best = answer.hypotheses[0];
    if (code === "low_probability") return notSure(answer, least);
    if (code === "several_places") return `${reason(code)} ${notSure(answer, least)}`;
    if (code === "low_inlier_ratio" && best) {
      return `${reason(code)} At the best place it is ${percent(best.inlier_ratio)}: it is not this map, or the map has changed.`;
    }
    if (code === "free_space_violation" && best) {
      return `${reason(code)} At the best place ${percent(best.free_space_violation, 1)} of its directions do.`;
    }
    return reason(code);
  });
}

function notSure(answer: Answer, least: number | null): string {
  const { probability } = answer;
  const tied = sharersOf(answer);
  if (least === null || probability >= least)
    return tied > 1 ? `${tied} places tie, and have ${chance(probability)} together.` : `The best place has ${chance(probability)}.`;
  const [found, asked] = chances(probability, least);
  return `${found} is less than the ${asked} asked for.`;
}
