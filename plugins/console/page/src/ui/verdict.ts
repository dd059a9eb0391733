import { token } from "./token";

const VERDICTS = ["localized", "ambiguous", "rejected"];

/** Colour of a verdict in pictures. */
export function colourOf(verdict: string): number {
  return token(VERDICTS.includes(verdict) ? `mark-${verdict}` : "mark-other");
}
