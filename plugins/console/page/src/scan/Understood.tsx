// What the service understood of the scan that is tried: a wrong unit or times that were left out are seen here.

import { scanReport } from "../api/scans";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import type { Asked } from "./asked";

export interface UnderstoodProps {
  asked: Asked;
  isAnswered: boolean; // its findings are in the answer
  isRefused: boolean; // the page says why
}

export function Understood({ asked, isAnswered, isRefused }: UnderstoodProps) {
  const report = useLoaded((signal) => scanReport(asked, signal), [asked]);
  if (report.error && isRefused) return null;
  if (report.error) return <ErrorText error={report.error} again={report.again} />;
  if (!report.value) return <p role="status">Reading the scan …</p>;
  const { facts, understood, findings } = report.value;
  return (
    <section aria-label="What was understood of the scan">
      <h3>What was understood</h3>
      <p>{facts}</p>
      <dl class="facts understood">
        {Object.entries(understood).map(([name, text]) => (
          <div key={name}>
            <dt>{name.replaceAll("_", " ")}</dt>
            <dd>{text}</dd>
          </div>
        ))}
      </dl>
      {isAnswered ? null : (
        <ul class="findings" aria-label="Findings of the scan">
          {findings.map((one) => (
            <li key={one.code}>
              {one.text} <small>{one.remedy}</small>
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}
