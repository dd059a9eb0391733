// What the record of a build says beyond its state, and which failed builds a person has read.

import { signal } from "@preact/signals";
import type { Schemas } from "../api/client";

/** A map with the version that answers. */
export type ActiveMap = Pick<Schemas["MapSummary"], "map_id" | "active_version">;

const PLACE = "firstfix.hidden-builds";
const MAX_HIDDEN = 200;
const TOLD_FROM = 0.05; // of the progress: before, the time that is left cannot be told

/** Failed builds that are not shown any more, in this browser. */
export const hidden = signal<string[]>(read());

export function hide(build: string): void {
  hidden.value = [...hidden.value, build].slice(-MAX_HIDDEN);
  try {
    localStorage.setItem(PLACE, JSON.stringify(hidden.value));
  } catch {
    return; // the browser keeps nothing: they are hidden until the page goes
  }
}

function read(): string[] {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(PLACE) ?? "[]");
    return Array.isArray(kept) ? kept.filter((one) => typeof one === "string") : [];
  } catch {
    return [];
  }
}

export function isGoing({ state }: Schemas["Build"]): boolean {
  return state === "queued" || state === "running";
}

/**
 * Whether the version was published and not activated, because its self-test says that it is not good. One that
 * somebody has activated since, as `maps` say, is not held back any more.
 */
export function isHeldBack(build: Schemas["Build"], maps: readonly ActiveMap[] = []): boolean {
  const isActive = maps.some((one) => one.map_id === build.map_id && one.active_version === build.version);
  return build.state === "succeeded" && build.activated === false && !isActive;
}

/** The version that a build made of another one by laying a patch over it; null: it made none. */
export function patchOf({ findings, version }: Schemas["Build"]): string | null {
  return findings.some(({ code }) => code === "map_patched") ? (version ?? null) : null;
}

/** Whether it failed for a reason that needs a person. A patch of a map of which nothing is confirmed needs none. */
export function hasFailed({ state, error }: Schemas["Build"]): boolean {
  return state === "failed" && error?.code !== "nothing_to_patch";
}

/** Why a build does not run yet, as far as the caller's builds and the service tell; "": it runs, or has ended. */
export function whyItWaits(build: Schemas["Build"], builds: readonly Schemas["Build"][]): string {
  if (build.state !== "queued") return "";
  if (build.waits_for) return `It waits: ${build.waits_for}.`;
  if (build.error) return `It is tried again, because of this: ${build.error.detail}`;
  const before = builds.filter((one) => isGoing(one) && one.build_id < build.build_id).map((one) => one.map_id);
  if (!before.length) return "It waits for its turn.";
  return `It waits for its turn, behind ${before.length === 1 ? "the build" : `${before.length} builds`} of ${[...new Set(before)].join(", ")}.`;
}

/** When the build was handed in, ISO 8601: its id begins with it. "": the id is of another kind. */
export function begunAt(build: string): string {
  const found = /^(\d{4})(\d\d)(\d\d)t(\d\d)(\d\d)(\d\d)/i.exec(build);
  if (!found) return "";
  const [, year, month, day, hour, minute, second] = found;
  return `${year}-${month}-${day}T${hour}:${minute}:${second}Z`;
}

/** Seconds since it was handed in, and those that it still takes if it goes on as fast; null: nobody knows. */
export function timesOf(build: Schemas["Build"], now: number): { past_s: number; left_s: number | null } | null {
  const begun = begunAt(build.build_id);
  if (!begun) return null;
  const past_s = Math.max(0, (now - Date.parse(begun)) / 1000);
  const { progress, state } = build;
  return { past_s, left_s: state === "running" && progress > TOLD_FROM ? (past_s * (1 - progress)) / progress : null };
}
