import type { Schemas } from "../api/client";
import { link } from "../router";
import type { MapCounts } from "./answerCounts";
import { needOf } from "./needOf";

export interface NeedsProps {
  maps: Schemas["MapSummary"][];
  counts: Map<string, MapCounts>;
}

/** What needs a person now, each with the way to where it is dealt with. */
export function Needs({ maps, counts }: NeedsProps) {
  const found = maps.flatMap((map) => {
    const need = needOf(map, counts.get(map.map_id));
    return need ? [{ map: map.map_id, ...need }] : [];
  });
  if (!found.length) return null;
  return (
    <section class="needs" aria-label="What needs a person now">
      <h2>Needs you</h2>
      <ul>
        {found.map((one) => (
          <li key={one.map}>
            <strong>{one.map}</strong> {one.text}. <a href={link(one.path, one.query)}>Look</a>
          </li>
        ))}
      </ul>
    </section>
  );
}
