import type { Schemas } from "../api/client";
import { link } from "../router";
import { When } from "../ui/When";
import { begunAt } from "./buildRecords";
import { EndedStages } from "./Stages";

/** Builds that have ended and need nobody, the newest first, each with its stages. */
export function EarlierBuilds({ builds, isNamed }: { builds: Schemas["Build"][]; isNamed: boolean }) {
  if (!builds.length) return null;
  return (
    <details class="earlier">
      <summary>Earlier builds</summary>
      <table class="cards">
        <thead>
          <tr>
            {isNamed ? <th>Map</th> : null}
            <th>Handed in</th>
            <th>State</th>
            <th>Stages</th>
          </tr>
        </thead>
        <tbody>
          {builds.map(({ build_id, map_id, state }) => (
            <tr key={build_id}>
              {isNamed ? (
                <th scope="row">
                  <a href={link(["maps", map_id])}>{map_id}</a>
                </th>
              ) : null}
              <td data-name="Handed in">{begunAt(build_id) ? <When iso={begunAt(build_id)} /> : build_id}</td>
              <td data-name="State">{state}</td>
              <td>
                <EndedStages build={build_id} />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </details>
  );
}
