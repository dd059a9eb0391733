// How far apart the lines of a grid over a map are.

import type { Box } from "./bulk";

const LINES = 24; // along the longer side, at most

/** Metres between the lines: 1, 2, 5, 10, ... */
export function gridStep([low, high]: Box): number {
  const least = Math.max(high[0] - low[0], high[1] - low[1], 1) / LINES;
  const power = 10 ** Math.floor(Math.log10(least));
  return power * ([1, 2, 5].find((one) => one * power >= least) ?? 10);
}
