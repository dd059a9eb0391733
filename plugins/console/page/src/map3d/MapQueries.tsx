import { recordedPage } from "../api/scans";
import { link } from "../router";
import { answerOf } from "../recorded/place";
import { ErrorText } from "../ui/ErrorText";
import { age } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { Verdict } from "../ui/Verdict";

const LISTED = 4;

/** The last recorded queries of the map, each with the way to try it again. */
export function MapQueries({ map }: { map: string }) {
  const page = useLoaded((signal) => recordedPage({ map_id: map, limit: LISTED }, signal), [map]);
  if (page.error) return <ErrorText error={page.error} again={page.again} />;
  const queries = page.value?.queries ?? [];
  return (
    <section aria-label="Recorded queries of the map">
      <h3>Recorded queries</h3>
      <ul class="lines">
        {queries.map((one) => (
          <li key={one.query_id}>
            <Verdict verdict={answerOf(one).verdict} /> {age(one.time)}{" "}
            <a href={link(["maps", map, "try"], { recorded: one.query_id })}>Look</a>
          </li>
        ))}
      </ul>
      {page.value && !queries.length ? <p class="hint">None was recorded of this map.</p> : null}
      {queries.length ? <a href={link(["recorded-queries"], { map })}>All recorded queries of {map}</a> : null}
    </section>
  );
}
