// What the queries have shown to be changed or never mapped: each area with who saw it and since when. A row moves the
// camera there.

import { useSignal } from "@preact/signals";
import type { MapChanges } from "../api/maps";
import { age, count } from "../ui/text";

type Area = MapChanges["areas"][number];
const LISTED = 8; // at first
const MIN_AWAY_M = 15;
const AWAY = 2.5; // of an area's diagonal
const NAMES: Record<Area["kind"], string> = { gone: "gone", new: "new", unmapped: "never mapped" };
const KINDS = Object.keys(NAMES) as Area["kind"][];

export interface ChangesPanelProps {
  found: MapChanges;
  /** Looks at a position from so many metres away. */
  look: (position: readonly number[], away: number) => void;
}

export function ChangesPanel({ found, look }: ChangesPanelProps) {
  const isWhole = useSignal(false);
  const { areas, areas_found, sightings, coverage_known } = found;
  const listed = isWhole.value ? areas : areas.slice(0, LISTED);
  return (
    <section aria-label="Changes">
      <h3>Changes since the map was made</h3>
      <p class="hint" role="status">
        {!sightings
          ? "No query was counted yet. Sure answers of robots show what has changed."
          : areas.length
            ? `As ${count(sightings)} queries show, the largest first.`
            : `Nothing has changed as far as ${count(sightings)} queries show.`}
      </p>
      {areas.length ? (
        <ul class="key" aria-label="Kinds of changes">
          {KINDS.map((kind) => (
            <li key={kind} class={kind}>
              {NAMES[kind]}: {kind === "unmapped" && !coverage_known ? "not known" : count(numberOf(areas, kind))}
            </li>
          ))}
        </ul>
      ) : null}
      {!coverage_known && numberOf(areas, "new") ? (
        <p class="hint">Parts that were never mapped are among the new ones: no query knew where the mapping run saw.</p>
      ) : null}
      <ul class="key spots" aria-label="Changed areas">
        {listed.map((one) => (
          <li key={`${one.kind} ${one.box.low.join()}`} class={one.kind}>
            <button onClick={() => look(middleOf(one), Math.max(MIN_AWAY_M, AWAY * Math.hypot(...extentOf(one))))}>
              {middleOf(one).map((m) => m.toFixed(1)).join(", ")} m
            </button>{" "}
            {NAMES[one.kind]}, {extentOf(one).map((m) => m.toFixed(1)).join(" × ")} m. {seenText(one)}
          </li>
        ))}
      </ul>
      {areas.length > listed.length ? (
        <button onClick={() => (isWhole.value = true)}>All {count(areas.length)} changes</button>
      ) : null}
      {areas_found > areas.length ? <p class="hint">{count(areas_found - areas.length)} more are not listed.</p> : null}
    </section>
  );
}

/** Who saw it: queries, since robots are not told apart, and the spots where they stood. */
function seenText({ sightings, spots, against, first_seen, last_seen }: Area): string {
  const seen = `${numbered(sightings, "query", "queries")} from ${numbered(spots, "spot", "spots")} saw it`;
  const denied = against ? `, ${count(against)} did not` : "";
  return `${seen}${denied}: first ${age(first_seen)}, last ${age(last_seen)}`;
}

function numbered(n: number, one: string, more: string): string {
  return `${count(n)} ${n === 1 ? one : more}`;
}

function numberOf(areas: Area[], kind: Area["kind"]): number {
  return areas.filter((one) => one.kind === kind).length;
}

function middleOf({ box }: Area): number[] {
  return box.low.map((low, axis) => (low + box.high[axis]!) / 2);
}

function extentOf({ box }: Area): number[] {
  return box.high.map((high, axis) => high - box.low[axis]!);
}
