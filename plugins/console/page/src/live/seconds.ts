// The last minutes of answers, second by second, for the plots.

import type { Schemas } from "../api/client";

export interface Fix {
  number: number;
  replica: string;
  time_s: number;
  caller: string;
  robot: string; // as it was named by itself, its gateway or its key; "": nobody named it
  transport: string;
  ms: number;
  answer: Pick<Schemas["Answer"], "verdict" | "probability" | "T_map_sensor"> & Partial<Pick<Schemas["Answer"], "fix_id">>; // of other replicas not much more
}

export interface Second {
  time_s: number;
  queries: number;
  localized: number;
  slowest_ms: number | null;
  median_ms: number | null;
}

export const SPAN_S = 120;

/** One entry for each second up to now, those without a query too. */
export function seconds(fixes: Fix[], now: number, span = SPAN_S): Second[] {
  const first = Math.floor(now) - span + 1;
  const times: number[][] = Array.from({ length: span }, () => []);
  const localized = new Array<number>(span).fill(0);
  for (const fix of fixes) {
    const slot = Math.floor(fix.time_s) - first;
    if (slot < 0 || slot >= span) continue;
    times[slot]!.push(fix.ms);
    if (fix.answer.verdict === "localized") localized[slot]! += 1;
  }
  return times.map((ms, i) => {
    ms.sort((a, b) => a - b);
    return {
      time_s: first + i,
      queries: ms.length,
      localized: localized[i]!,
      slowest_ms: ms.at(-1) ?? null,
      median_ms: ms[ms.length >> 1] ?? null,
    };
  });
}
