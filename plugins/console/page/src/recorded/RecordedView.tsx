// Recorded queries: why was this scan not localized?

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { mapPage } from "../api/maps";
import { removeRecorded, recordedPage } from "../api/scans";
import { go, route } from "../router";
import { Confirm } from "../ui/Confirm";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { age, percent } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { exported } from "./exported";
import { filterOf, Filters } from "./Filters";
import { NotRecorded } from "./NotRecorded";
import { answerOf, type RecordedQuery } from "./place";
import { QueryPins } from "./QueryPins";
import { QueryTable } from "./QueryTable";

export function RecordedView() {
  const filter = filterOf(route.value.query);
  const map = filter.map_id;
  const after = useSignal<string[]>([]); // of the pages up to this one
  const pointedAt = useSignal("");
  const problem = useSignal<unknown>(null);
  const share = useSignal<number | null>(null);
  const filtered = [filter.map_id, filter.verdict, filter.reason];
  useEffect(() => {
    after.value = [];
  }, filtered);
  const maps = useLoaded(mapPage, []);
  const page = useLoaded(
    (signal) => recordedPage({ ...filter, after: after.value.at(-1), limit: 50 }, signal),
    [...filtered, after.value],
  );
  const doomed = useSignal<RecordedQuery | null>(null);
  const save = async () => {
    problem.value = null;
    try {
      share.value = 0;
      await exported(map, (done) => (share.value = done));
    } catch (error) {
      problem.value = error;
    }
    share.value = null;
  };
  const queries = page.value?.queries ?? [];
  return (
    <main class="page">
      <header class="row">
        <h1>Recorded queries</h1>
        <Filters maps={(maps.value?.maps ?? []).map((one) => one.map_id)} />
        <button onClick={save} disabled={!map || share.value !== null}>
          {share.value === null ? "Export those with a truth" : `Exporting, ${percent(share.value)}`}
        </button>
      </header>
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {page.error ? <ErrorText error={page.error} again={page.again} /> : null}
      {page.value && !queries.length ? (
        <Empty title={filtered.some(Boolean) ? "No recorded query is like this" : "No recorded query"}>
          <NotRecorded share={page.value.share} isFiltered={filtered.some(Boolean)} />
        </Empty>
      ) : null}
      {map ? (
        <QueryPins
          key={map}
          map={map}
          queries={queries}
          pointedAt={pointedAt.value}
          open={(recorded) => go(["maps", map, "try"], { recorded: recorded.query_id })}
        />
      ) : queries.length ? (
        <p class="hint">Choose a map to see where they were taken.</p>
      ) : null}
      {queries.length ? (
        <QueryTable queries={queries} remove={(recorded) => (doomed.value = recorded)} point={(queryId) => (pointedAt.value = queryId)} />
      ) : null}
      {doomed.value ? (
        <Confirm
          title="Remove this recorded query"
          action="Remove for good"
          keep="Keep it"
          act={async () => {
            await removeRecorded(doomed.value!.query_id);
            page.again();
          }}
          close={() => (doomed.value = null)}
        >
          <p>
            The scan of {age(doomed.value.time)} about {doomed.value.map_id || "any map"} ({answerOf(doomed.value).verdict})
            is deleted{doomed.value.truth ? ", with the place that somebody told for it" : ""}. It cannot be brought back.
          </p>
        </Confirm>
      ) : null}
      <div class="row">
        {after.value.length ? <button onClick={() => (after.value = after.value.slice(0, -1))}>Newer</button> : null}
        {page.value?.next ? <button onClick={() => (after.value = [...after.value, page.value!.next!])}>Older</button> : null}
      </div>
    </main>
  );
}
