// What the self-test says about one place, and which places it is confused with.

import { metres, percent } from "../ui/text";
import { helpAt, localizedShare, type SpotCell, type SpotGrid } from "./spots";

const LISTED = 12;

export interface SpotPanelProps {
  grid: SpotGrid;
  chosen: SpotCell | null;
  choose: (one: SpotCell | null) => void;
}

export function SpotPanel({ grid, chosen, choose }: SpotPanelProps) {
  if (!grid.cells.length) return <p class="hint">The self-test of this version has no places.</p>;
  const name = (cell: [number, number]) => grid.middle(cell).slice(0, 2).map(metres).join(", ");
  const go = (cell: [number, number]) => choose(grid.at(grid.middle(cell)) ?? null);
  const away = (one: SpotCell) => {
    const [from, to] = [grid.middle(one.cell), grid.middle(one.taken_for!)];
    return Math.hypot(from[0] - to[0], from[1] - to[1]);
  };
  const alike = chosen ? grid.takenFor(chosen.cell) : [];
  return (
    <section aria-label="Places of the self-test">
      <h3>{chosen ? `Place at ${name(chosen.cell)}` : "Places that look like others"}</h3>
      {chosen ? (
        <>
          <p>
            {percent(localizedShare(chosen))} of {chosen.scans} scans were localized, {chosen.wrong} wrongly.
          </p>
          {helpAt(chosen) ? (
            <p>
              Known and not said: the right place is best or ties in {chosen.found} scans. What helps is {helpAt(chosen)}.
            </p>
          ) : null}
          {chosen.in_part ? (
            <p>
              Mapped in part, from a door or from afar: {percent(chosen.never_seen ?? 0)} of the space around was never
              seen. Drive through it while mapping.
            </p>
          ) : null}
          {chosen.taken_for ? (
            <p>
              The others look most like <button onClick={() => go(chosen.taken_for!)}>{name(chosen.taken_for)}</button>
            </p>
          ) : null}
          {alike.length ? (
            <p>
              Taken for this one:{" "}
              {alike.map((one) => (
                <button key={one.cell.join()} onClick={() => choose(one)}>
                  {name(one.cell)}
                </button>
              ))}
            </p>
          ) : null}
          <button onClick={() => choose(null)}>All places</button>
        </>
      ) : (
        <>
          <p class="hint">Click a place on the map, or choose one.</p>
          <ul class="spots">
            {worstOf(grid).slice(0, LISTED).map((one) => (
              <li key={one.cell.join()}>
                <button onClick={() => choose(one)}>{name(one.cell)}</button> like one {away(one).toFixed(0)} m away;{" "}
                {one.localized} of {one.scans} localized
              </li>
            ))}
          </ul>
        </>
      )}
    </section>
  );
}

/** Places that look like others, those where most scans were lost first. */
function worstOf(grid: SpotGrid): SpotCell[] {
  return [...grid.confused].sort((a, b) => b.scans - b.localized - (a.scans - a.localized));
}
