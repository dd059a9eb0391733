// What about a map needs a person: answers that somebody judged wrong, builds that failed, and a patch that waits.

import type { Schemas } from "../api/client";
import { begunAt, hasFailed, isHeldBack, patchOf } from "../maps/buildRecords";
import { patchAddress } from "../patch/PatchLink";
import { link } from "../router";
import { judgementOf } from "../recorded/judgement";
import { answerOf, type RecordedQuery } from "../recorded/place";
import { age } from "../ui/text";
import type { Alert } from "./robotsOf";

const DAY_S = 86_400; // older answers are no alert any more

/** Of the recorded queries of the last day. */
export function answerAlerts(queries: readonly RecordedQuery[], map: string, now_s: number): Alert[] {
  return queries.flatMap((recorded) => {
    const judgement = judgementOf(recorded, answerOf(recorded), map);
    if (!judgement || now_s - Date.parse(recorded.time) / 1000 > DAY_S) return [];
    const text = `${judgement.kind === "false" ? "False" : "Disputed"}: an answer of ${age(recorded.time, now_s * 1000)} ${judgement.text}.`;
    return [{ id: `${judgement.kind}:${recorded.query_id}`, text, look: link(["maps", map, "try"], { recorded: recorded.query_id }) }];
  });
}

/** Of the builds that failed since the last one that succeeded. `builds`: the newest first. */
export function buildAlerts(builds: readonly Schemas["Build"][], hidden: readonly string[], now_s: number): Alert[] {
  const good = builds.findIndex((one) => one.state === "succeeded");
  const since = good < 0 ? builds : builds.slice(0, good);
  return since.flatMap((build) => {
    if (!hasFailed(build) || hidden.includes(build.build_id)) return [];
    const begun = begunAt(build.build_id);
    const when = begun ? ` of ${age(begun, now_s * 1000)}` : "";
    const why = build.error?.detail ? `: ${build.error.detail}` : "";
    return [{ id: `build:${build.build_id}`, text: `The build${when} failed${why}`, look: link([]) }];
  });
}

/** The newest build that succeeded, if it is a patch that was not activated and not put out of sight. */
export function waitingPatch(builds: readonly Schemas["Build"][], hidden: readonly string[]): Schemas["Build"] | null {
  const newest = builds.find((one) => one.state === "succeeded");
  return newest && isHeldBack(newest) && patchOf(newest) && !hidden.includes(newest.build_id) ? newest : null;
}

/** `active`: the version that the map serves. */
export function patchAlerts(build: Schemas["Build"] | null, active: string | null, now_s: number): Alert[] {
  const version = build && patchOf(build);
  if (!version || version === active) return [];
  const begun = begunAt(build.build_id);
  const when = begun ? ` of ${age(begun, now_s * 1000)}` : "";
  const text = `A patch${when} waits for somebody to activate it.`;
  return [{ id: `patch:${build.build_id}`, text, look: patchAddress(build.map_id, version) }];
}
