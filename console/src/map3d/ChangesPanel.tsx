// What the queries have shown to be changed, in words: the largest areas, and how many queries were counted.

import type { MapChanges } from "../api/maps";
import { count, metres } from "../ui/text";

type Area = MapChanges["areas"][number];
const LISTED = 8;

export interface ChangesPanelProps {
  found: MapChanges;
  look: (position: readonly number[]) => void;
}

export function ChangesPanel({ found, look }: ChangesPanelProps) {
  if (!found.areas.length) {
    return (
      <p class="hint" role="status">
        {found.sightings
          ? `Nothing has changed as far as ${count(found.sightings)} queries show.`
          : "No query was counted yet. Sure answers of robots show what has changed."}
      </p>
    );
  }
  return (
    <section aria-label="Changes">
      <h3>Changes that {count(found.sightings)} queries show</h3>
      <ul class="key">
        <li class="contradicts">gone: {count(numberOf(found, "gone"))}</li>
        <li class="agrees">new: {count(numberOf(found, "new"))}</li>
      </ul>
      <ul class="spots">
        {found.areas.slice(0, LISTED).map((one) => (
          <li key={`${one.kind} ${one.box.low.join()}`}>
            <button onClick={() => look(middleOf(one))}>{middleOf(one).slice(0, 2).map(metres).join(", ")}</button>{" "}
            {one.kind}, {one.spots} spots
          </li>
        ))}
      </ul>
    </section>
  );
}

function numberOf({ areas }: MapChanges, kind: Area["kind"]): number {
  return areas.filter((one) => one.kind === kind).length;
}

function middleOf({ box }: Area): number[] {
  return box.low.map((low, axis) => (low + box.high[axis]!) / 2);
}
