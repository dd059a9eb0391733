// Kept queries: why was this scan not localized?

import { useSignal } from "@preact/signals";
import { mayAdminister } from "../access/session";
import { change, get, type Schemas } from "../api/client";
import { link } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { age, percent, reason, size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { Verdict } from "../ui/Verdict";
import { exported } from "./exported";

type Sample = Schemas["Sample"];
const VERDICTS = ["", "localized", "ambiguous", "rejected"];

export function SamplesView() {
  const map = useSignal("");
  const verdict = useSignal("");
  const after = useSignal<string[]>([]); // of the pages up to this one
  const problem = useSignal<unknown>(null);
  const share = useSignal<number | null>(null);
  const maps = useLoaded((signal) => get<Schemas["MapPage"]>("/maps", { limit: 1000 }, signal), []);
  const page = useLoaded(
    (signal) =>
      get<Schemas["SamplePage"]>(
        "/samples",
        { map_id: map.value, verdict: verdict.value, after: after.value.at(-1), limit: 50 },
        signal,
      ),
    [map.value, verdict.value, after.value],
  );
  const remove = async (sample: Sample) => {
    try {
      await change("DELETE", `/samples/${sample.sample_id}`);
      page.again();
    } catch (error) {
      problem.value = error;
    }
  };
  const save = async () => {
    try {
      share.value = 0;
      await exported(map.value, (done) => (share.value = done));
    } catch (error) {
      problem.value = error;
    }
    share.value = null;
  };
  return (
    <main class="page">
      <header class="row">
        <h1>Kept queries</h1>
        <label>
          Map
          <select
            value={map.value}
            onChange={(event) => {
              map.value = event.currentTarget.value;
              after.value = [];
            }}
          >
            <option value="">All</option>
            {(maps.value?.maps ?? []).map((one) => (
              <option key={one.map_id}>{one.map_id}</option>
            ))}
          </select>
        </label>
        <label>
          Verdict
          <select
            value={verdict.value}
            onChange={(event) => {
              verdict.value = event.currentTarget.value;
              after.value = [];
            }}
          >
            {VERDICTS.map((one) => (
              <option key={one} value={one}>
                {one || "All"}
              </option>
            ))}
          </select>
        </label>
        <button onClick={save} disabled={!map.value || share.value !== null}>
          {share.value === null ? "Export those with a truth" : `Exporting, ${percent(share.value)}`}
        </button>
      </header>
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {page.error ? <ErrorText error={page.error} again={page.again} /> : null}
      {page.value && !page.value.samples.length ? (
        <Empty title="No kept query">
          <p>
            The service keeps some of the queries that it cannot localize if <code>FIRSTFIX_SAMPLES_SHARE</code> is
            above 0.
          </p>
        </Empty>
      ) : null}
      {page.value?.samples.length ? (
        <table>
          <thead>
            <tr>
              <th>When</th>
              <th>Map</th>
              <th>Verdict</th>
              <th>Why</th>
              <th class="number">Probability</th>
              <th class="number">Size</th>
              <th>Truth</th>
              <th />
            </tr>
          </thead>
          <tbody>
            {page.value.samples.map((one) => (
              <Row key={one.sample_id} sample={one} remove={() => remove(one)} />
            ))}
          </tbody>
        </table>
      ) : null}
      <div class="row">
        {after.value.length ? <button onClick={() => (after.value = after.value.slice(0, -1))}>Newer</button> : null}
        {page.value?.next ? <button onClick={() => (after.value = [...after.value, page.value!.next!])}>Older</button> : null}
      </div>
    </main>
  );
}

function Row({ sample, remove }: { sample: Sample; remove: () => void }) {
  const answer = sample.answer as unknown as Schemas["Answer"];
  const map = answer.map_id || sample.map_id.split(",")[0] || "";
  return (
    <tr>
      <td title={sample.time}>{age(sample.time)}</td>
      <td>{sample.map_id || "any"}</td>
      <td>
        <Verdict verdict={answer.verdict} />
      </td>
      <td>{answer.reasons.map(reason).join(" ")}</td>
      <td class="number">{percent(answer.probability, 1)}</td>
      <td class="number">{size(sample.body_bytes)}</td>
      <td>{sample.truth ? (sample.truth.T_map_sensor ? "known" : "not in the map") : ""}</td>
      <td class="actions">
        {map ? <a href={link(["maps", map, "try"], { sample: sample.sample_id })}>Look</a> : null}
        {mayAdminister.value ? <button onClick={remove}>Remove</button> : null}
      </td>
    </tr>
  );
}
