// How many queries of each map were answered lately: of the replica that gives the page.

import { mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { answerCounts } from "../api/scans";
import { count, percent } from "../ui/text";
import { usePolled } from "../ui/usePolled";

export type MapCounts = Schemas["MapAnswerCounts"];
const LOOK_MS = 5000;

/** By map. A map that was not asked is not in it, and none is for callers that may not see answers. */
export function useAnswerCounts(): Map<string, MapCounts> {
  const { value } = usePolled(
    async (signal) => (mayBuild.value ? await answerCounts(signal) : null),
    [mayBuild.value],
    LOOK_MS,
  );
  return new Map((value?.maps ?? []).map((one) => [one.map_id, one]));
}

/** What counts in a cell: how many, and how many of them were localized. */
export function countedTexts({ answered, localized }: Schemas["CountedAnswers"]): [string, string] {
  return answered ? [count(answered), `${percent(localized / answered)} localized`] : ["none", ""];
}
