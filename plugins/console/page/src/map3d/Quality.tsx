// Is this version good? What its self-test says, what it was made of, and where to look next.

import { versionDetails, versionReport } from "../api/maps";
import { bytesOf, extentOf, judged, type Manifest, manifestOf } from "../maps/manifest";
import { MapFindings } from "../maps/MapFindings";
import { link } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { count, percent, size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { RealScans, realFacts } from "./RealScans";
import { cellsOf, helpAt, localizedShare, type SpotCell } from "./spots";

export interface QualityProps {
  map: string;
  version: string;
  showHeat: (() => void) | null; // null: it is shown
}

export function Quality({ map, version, showHeat }: QualityProps) {
  const details = useLoaded((signal) => versionDetails(map, version, signal), [map, version]);
  const report = useLoaded((signal) => versionReport(map, version, signal), [map, version]);
  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  if (!details.value) return <p role="status">Reading the self-test …</p>;
  const manifest = manifestOf(details.value);
  const { grade, text } = judged(manifest);
  const real = manifest.self_test?.real;
  const cells = report.value ? cellsOf(report.value) : [];
  return (
    <section aria-label="Is it good?">
      <p class="is-it-good">
        <strong class={`grade ${grade}`}>{grade}</strong> {details.value.active ? null : <span class="tag">not active</span>}{" "}
        {text}
      </p>
      {report.error ? <ErrorText error={report.error} again={report.again} /> : null}
      {report.value ? <MapFindings findings={report.value.findings} /> : null}
      <dl class="facts">
        {factsOf(manifest, cells).map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {real ? <RealScans {...real} /> : null}
      <NotSaid cells={cells} />
      <div class="row">
        <a href={link(["maps", map, "try"], details.value.active ? {} : { version })}>Try a scan in it</a>
        {showHeat && cells.length ? <button onClick={showHeat}>Show where it is good</button> : null}
      </div>
    </section>
  );
}

/** The places that are known and not said, by what helps there. */
function NotSaid({ cells }: { cells: SpotCell[] }) {
  const helps = cells.map(helpAt).filter((help) => help);
  if (!helps.length) return null;
  return (
    <details>
      <summary>
        {helps.length} of {cells.length} places {helps.length === 1 ? "is" : "are"} known and not said
      </summary>
      <p>The right place is the best there, or ties with it, and is not sure enough to be said. What helps:</p>
      <ul class="lines">
        {[...new Set(helps)].map((help) => (
          <li key={help}>
            {help}: {helps.filter((one) => one === help).length}
          </li>
        ))}
      </ul>
    </details>
  );
}

function factsOf(manifest: Manifest, cells: SpotCell[]): [string, string][] {
  const { self_test: test, counts = {}, sensor } = manifest;
  const facts: [string, string | null][] = [
    ["Localized in its self-test", test?.localized === undefined ? null : `${percent(test.localized)} of ${test.queries ?? "its"} scans`],
    ["Right place first, or among those that tie", test?.found === undefined ? null : percent(test.found)],
    ["Sure and wrong", test?.false_accepts === undefined ? null : String(test.false_accepts)],
    ["Best place within 0.2 m", test?.success?.["0.2m"] === undefined ? null : percent(test.success["0.2m"])],
    ["Median error", (test?.median_error_m ?? -1) >= 0 ? `${(100 * test!.median_error_m!).toFixed(1)} cm` : null],
    ...realFacts(test?.real ?? {}),
    ["Places where it localizes", cells.length ? `${cells.filter(isFound).length} of ${cells.length}` : null],
    ["Sensor", sensor?.name ? `${sensor.name}, ${sensor.mount_height_m} m above the floor` : null],
    ["Size", extentOf(manifest).map((m) => m.toFixed(0)).join(" × ") || null],
    ["Templates", counts.templates === undefined ? null : count(counts.templates)],
    ["Points", counts.map_points === undefined ? null : count(counts.map_points)],
    ["Files", bytesOf(manifest) ? size(bytesOf(manifest)) : null],
  ];
  return facts
    .filter((fact): fact is [string, string] => fact[1] !== null)
    .map(([name, value]) => [name, name === "Size" ? `${value} m` : value]);
}

/** Whether at least half of the scans of a place were localized. */
function isFound(cell: SpotCell): boolean {
  return localizedShare(cell) >= 0.5;
}
