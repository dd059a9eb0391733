// Two versions side by side: their self-tests, and where one localizes better than the other.

import type { Schemas } from "../api/client";
import { versionReport } from "../api/maps";
import { ErrorText } from "../ui/ErrorText";
import { count, percent, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { Changed } from "./Changed";
import { Difference } from "./Difference";
import { whyDifferent } from "./whyDifferent";

type Report = Schemas["VersionReport"];
type Version = Schemas["VersionSummary"];

export function Comparison({ map, versions: compared }: { map: string; versions: [Version, Version] }) {
  const versions = compared.map(({ version }) => version) as [string, string];
  const reports = useLoaded(
    (signal) => Promise.all(versions.map((one) => versionReport(map, one, signal))),
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
    ["Right place first, or among those that tie", (report) => share(report.self_test.found)],
    ["Localized", (report) => share(report.self_test.localized)],
    ["False accepts", (report) => numberOf(report.self_test.false_accepts)],
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
      <h3>Why they differ</h3>
      <ul class="findings" aria-label="Why they differ">
        {whyDifferent(...compared).map((text) => (
          <li key={text}>{text}</li>
        ))}
      </ul>
      <Changed map={map} versions={versions} />
      <Difference key={versions.join()} map={map} versions={versions} />
    </section>
  );
}

function share(value: unknown): string {
  return typeof value === "number" ? percent(value, 1) : "";
}

function numberOf(value: unknown): string {
  return typeof value === "number" ? count(value) : "";
}

function shareOf(report: Report, name: string, key: string): string {
  return share((report.self_test[name] as Record<string, number> | undefined)?.[key]);
}
