// What a version's manifest says: how good the version is, how large, and how sure an answer must be.

import type { Schemas } from "../api/client";

export interface Manifest {
  bounds?: [number[], number[]];
  counts?: Record<string, number>;
  files?: Record<string, { bytes: number }>;
  provisional?: boolean;
  sensor?: { name?: string; mount_height_m?: number; max_range_m?: number };
  self_test?: SelfTest;
  source?: { patch?: Patch };
}

/** What a build that patched a map tells of it. */
export interface Patch {
  base: string; // the version that it was laid over
  areas: PatchedArea[];
  queries: number; // that counted
  robots: number; // that asked them
  replayed: number; // queries that were told before, and did not count
  doubtful: number; // queries at a doubtful pose, which did not count
  compared: ComparedVersions;
}

export interface PatchedArea {
  kind: "gone" | "new" | "unmapped"; // by earlier releases, what was never mapped is new
  low_m: number[]; // lowest corner, in the map's frame
  high_m: number[];
  robots: number; // that saw it
  days: number; // on which it was seen
}

/** Answers of the base and of the patched version to the same scans, at places that have not changed. */
interface ComparedVersions {
  places: number;
  localized_before: number;
  localized_after: number;
  lost: number;
  won: number;
  wrong_before: number;
  wrong_after: number;
}

interface SelfTest {
  queries?: number;
  localized?: number; // share of the scans that were taken in the map
  found?: number; // share whose right place is the best or ties; a version is activated by it
  false_accepts?: number; // answers "localized" at a wrong place
  median_error_m?: number | null;
  success?: Record<string, number>; // share whose best place is near enough, whatever the verdict: "0.2m"
  threshold?: { min_probability?: number };
  real?: RealScansTest;
}

/** What the self-test says of real scans: keyframes held out of the map, scans beside it, confirmed queries. */
export interface RealScansTest {
  asked?: number;
  localized?: number;
  false_accepts?: number;
  disagree?: string[]; // shares that differ from those of the simulated scans by more than chance: "1m", "localized"
  left_out?: Record<string, string>; // why, by the scan's name
  held_out?: { keyframes: number; parts: number; kept_out: Record<string, number> } | null;
}

const USUAL_LEAST = 0.995; // of a version without a threshold of its own
const GOOD = 0.8;
const FAIR = 0.5;
const FOUND = 0.7; // with fewer found, a version is not activated by itself

/** The manifest is open in the API: other programs may have put more into it, and older ones less. */
export function manifestOf(details: Schemas["MapDetails"] | Schemas["VersionDetails"] | null): Manifest {
  return (details?.manifest ?? {});
}

/** The probability from which on this version answers "localized". */
export function leastOf(manifest: Manifest): number {
  return manifest.self_test?.threshold?.min_probability ?? USUAL_LEAST;
}

export interface Judgement {
  grade: "good" | "fair" | "poor" | "unknown";
  text: string;
}

/** What the self-test says in a word, and what to do. */
export function judged(manifest: Manifest): Judgement {
  const { localized, found, false_accepts: wrong = 0 } = manifest.self_test ?? {};
  if (manifest.provisional) {
    return { grade: "unknown", text: "It is provisional: coarse and little tested, until its build has ended." };
  }
  if (localized === undefined) return { grade: "unknown", text: "It has no self-test, so nobody knows." };
  if (wrong > 0) {
    return { grade: "poor", text: "Its self-test found answers that were sure and wrong. See where places look alike." };
  }
  if (localized >= GOOD) return { grade: "good", text: "Most scans of its self-test were localized." };
  if (found === undefined ? localized >= FAIR : found >= FOUND) {
    return { grade: "fair", text: "In some places a robot has to ask again. The layer of where a robot finds itself shows them." };
  }
  return {
    grade: "poor",
    text: "The places of few scans of its self-test are known. Check unit, upward axis and sensor of the build, and see where it fails.",
  };
}

/** As `judged`, by what a list of maps tells of the active version. */
export function judgedBySummary({ provisional, summary }: Schemas["MapSummary"]): Judgement {
  const { localized, found, false_accepts } = summary;
  return judged({
    provisional,
    self_test: { localized: localized ?? undefined, found: found ?? undefined, false_accepts: false_accepts ?? undefined },
  });
}

export function bytesOf(manifest: Manifest): number {
  return Object.values(manifest.files ?? {}).reduce((sum, file) => sum + file.bytes, 0);
}

/** Length, width and height, metres. */
export function extentOf({ bounds }: Manifest): number[] {
  return bounds?.length === 2 ? bounds[1].map((high, axis) => high - bounds[0][axis]!) : []; // other programs may give none
}
