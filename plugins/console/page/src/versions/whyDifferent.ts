// Why two versions of a map localize another share of their self-tests, in sentences: the weightiest reason first.

import type { Schemas } from "../api/client";

type Version = Schemas["VersionSummary"];
const ALIKE = 0.03; // of two shares: less is chance

export function whyDifferent(one: Version, two: Version): string[] {
  return [ofSource(one, two), ofSensor(one, two), ofSize(one, two), ofThreshold(one, two), ofRelease(one, two)]
    .flatMap((text) => (text ? [text] : []))
    .concat(isSame(one, two) ? ["Both were made of the same file, for the same sensor, with the same threshold: what differs is in the table below."] : []);
}

function ofSource({ provenance: one }: Version, { provenance: two }: Version): string {
  if (!one.file_name || !two.file_name) return "One of them does not say what it was made of: an earlier release built it.";
  if (one.sha256 && one.sha256 === two.sha256) {
    return one.trajectory === two.trajectory ? "" : `The poses of the mapping run are others: ${named(one.trajectory)} and ${named(two.trajectory)}.`;
  }
  if (one.file_name === two.file_name) return `Both were made of a file ${one.file_name}, with another content.`;
  return `They were made of other files: ${one.file_name} and ${two.file_name}.`;
}

function ofSensor({ summary: one }: Version, { summary: two }: Version): string {
  return one.sensor === two.sensor ? "" : `Their sensors are others: ${named(one.sensor)} and ${named(two.sensor)}.`;
}

function ofSize({ summary: one }: Version, { summary: two }: Version): string {
  if (!one.size_m || !two.size_m) return "";
  const isOther = one.size_m.some((m, axis) => Math.abs(m - two.size_m![axis]!) > Math.max(1, 0.05 * m));
  const text = (m: number[]) => m.map((each) => each.toFixed(0)).join(" × ");
  return isOther ? `Their maps are of other sizes: ${text(one.size_m)} m and ${text(two.size_m)} m.` : "";
}

function ofThreshold({ summary: one }: Version, { summary: two }: Version): string {
  const [first, second] = [one.threshold?.min_probability, two.threshold?.min_probability];
  if (first === undefined || second === undefined || first === second) return "";
  const asked = `The first answers "localized" from ${percent(first)}, the second from ${percent(second)}`;
  const why = ", as each self-test measured how often that would be wrong";
  const areAlike = typeof one.found === "number" && typeof two.found === "number" && Math.abs(one.found - two.found) < ALIKE;
  const rest = areAlike ? ` Both know as many places (${percent(one.found!)} and ${percent(two.found!)}): the threshold makes the difference.` : "";
  return `${asked}${why}.${rest}`;
}

function ofRelease({ provenance: one }: Version, { provenance: two }: Version): string {
  return one.release && two.release && one.release !== two.release ? `Releases ${one.release} and ${two.release} built them.` : "";
}

function isSame(one: Version, two: Version): boolean {
  return !ofSource(one, two) && !ofSensor(one, two) && !ofSize(one, two) && !ofThreshold(one, two) && !ofRelease(one, two);
}

/** With the digits that tell it from another one: "90 %", "99.5 %". */
function percent(share: number): string {
  return `${parseFloat((100 * share).toFixed(2))} %`;
}

function named(text: string | null | undefined): string {
  return text || "none";
}
