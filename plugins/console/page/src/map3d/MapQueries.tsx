import { samplePage } from "../api/scans";
import { link } from "../router";
import { answerOf } from "../recorded/place";
import { ErrorText } from "../ui/ErrorText";
import { age } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { Verdict } from "../ui/Verdict";

const LISTED = 4;

/** The last queries of the map that were kept, each with the way to try it again. */
export function MapQueries({ map }: { map: string }) {
  const page = useLoaded((signal) => samplePage({ map_id: map, limit: LISTED }, signal), [map]);
  if (page.error) return <ErrorText error={page.error} again={page.again} />;
  const samples = page.value?.samples ?? [];
  return (
    <section aria-label="Kept queries of the map">
      <h3>Kept queries</h3>
      <ul class="lines">
        {samples.map((one) => (
          <li key={one.sample_id}>
            <Verdict verdict={answerOf(one).verdict} /> {age(one.time)}{" "}
            <a href={link(["maps", map, "try"], { sample: one.sample_id })}>Look</a>
          </li>
        ))}
      </ul>
      {page.value && !samples.length ? <p class="hint">None was kept of this map.</p> : null}
      {samples.length ? <a href={link(["samples"], { map })}>All kept queries of {map}</a> : null}
    </section>
  );
}
