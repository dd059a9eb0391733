// Two versions side by side: their self-tests, and where one localizes better than the other.

import { get, type Schemas } from "../api/client";
import type { SpotCell } from "../map3d/layerMarks";
import { ErrorText } from "../ui/ErrorText";
import { count, percent, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

type Report = Schemas["VersionReport"];

export function Comparison({ map, versions }: { map: string; versions: [string, string] }) {
  const reports = useLoaded(
    (signal) =>
      Promise.all(versions.map((one) => get<Report>(`/maps/${map}/versions/${one}/report`, {}, signal))),
    [map, ...versions],
  );
  if (reports.error) return <ErrorText error={reports.error} again={reports.again} />;
  if (!reports.value) return <p role="status">Reading the reports …</p>;
  const [a, b] = reports.value as [Report, Report];
  const rows: [string, (report: Report) => string][] = [
    ["Templates", (report) => count(report.counts.templates ?? 0)],
    ["Map points", (report) => count(report.counts.map_points ?? 0)],
    ["Sensor", (report) => String(report.sensor.name)],
    ["Within 0.2 m", (report) => shareOf(report, "success", "0.2m")],
    ["Localized", (report) => share(report.self_test.localized)],
    ["False accepts", (report) => String(report.self_test.false_accepts ?? "")],
  ];
  return (
    <section aria-label="Comparison">
      <h2>Side by side</h2>
      <table>
        <thead>
          <tr>
            <th />
            {versions.map((one) => (
              <th key={one}>
                <code>{short(one)}</code>
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(([name, text]) => (
            <tr key={name}>
              <th scope="row">{name}</th>
              <td>{text(a)}</td>
              <td>{text(b)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <h3>Where the second localizes better (green) or worse (red)</h3>
      <Difference before={cellsOf(a)} after={cellsOf(b)} />
    </section>
  );
}

function cellsOf(report: Report): SpotCell[] {
  return (report.self_test.localizability ?? []) as SpotCell[];
}

/** Squares of the self-test's grid, coloured by the change of the localized share. */
function Difference({ before, after }: { before: SpotCell[]; after: SpotCell[] }) {
  const old = new Map(before.map((one) => [one.cell.join(), one.localized / one.scans]));
  const both = after
    .filter((one) => old.has(one.cell.join()))
    .map((one) => ({ cell: one.cell, gain: one.localized / one.scans - old.get(one.cell.join())! }));
  if (!both.length) return <p class="hint">The self-tests share no place.</p>;
  const xs = both.map(({ cell }) => cell[0]);
  const ys = both.map(({ cell }) => cell[1]);
  const [left, top] = [Math.min(...xs), Math.max(...ys)];
  const [width, height] = [Math.max(...xs) - left + 1, top - Math.min(...ys) + 1];
  const better = both.filter(({ gain }) => gain > 0).length;
  const worse = both.filter(({ gain }) => gain < 0).length;
  const text = `${both.length} places: ${better} better, ${worse} worse`;
  return (
    <figure>
      <svg class="difference" viewBox={`0 0 ${width} ${height}`} role="img" aria-label={text}>
        {both.map(({ cell: [x, y], gain }) => (
          <rect
            key={`${x},${y}`}
            x={x - left}
            y={top - y}
            width={0.95}
            height={0.95}
            class={gain > 0 ? "better" : gain < 0 ? "worse" : "same"}
            opacity={gain === 0 ? 0.35 : 0.4 + 0.6 * Math.abs(gain)}
          />
        ))}
      </svg>
      <figcaption>{text}</figcaption>
    </figure>
  );
}

function share(value: unknown): string {
  return typeof value === "number" ? percent(value, 1) : String(value ?? "");
}

function shareOf(report: Report, name: string, key: string): string {
  return share((report.self_test[name] as Record<string, number> | undefined)?.[key]);
}
