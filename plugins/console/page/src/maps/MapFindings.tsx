import type { Schemas } from "../api/client";

const WORDS: Record<string, string> = { error: "Wrong", warning: "Warning", info: "Note" };

/** What a check of the map has found, each with what helps. */
export function MapFindings({ findings }: { findings: Schemas["Finding"][] }) {
  if (!findings.length) return <p class="hint">The checks of the map found nothing wrong.</p>;
  return (
    <ul class="findings" aria-label="Findings">
      {findings.map((one) => (
        <li key={one.code} class={one.severity}>
          <strong>{WORDS[one.severity] ?? one.severity}:</strong> {one.text}
          <small>{one.remedy}</small>
        </li>
      ))}
    </ul>
  );
}
