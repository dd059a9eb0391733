import type { RealScansTest } from "../maps/manifest";
import { percent } from "../ui/text";

/** Facts of the real scans that the self-test asked, as names and values. */
export function realFacts({ asked, localized, false_accepts, held_out }: RealScansTest): [string, string][] {
  const facts: [string, string][] = [];
  if (asked) {
    facts.push(["Real scans localized", `${percent(localized ?? 0)} of ${asked} scans`]);
    facts.push(["Real scans sure and wrong", String(false_accepts ?? 0)]);
  }
  if (held_out?.keyframes) {
    facts.push(["The map was made without", `${held_out.keyframes} keyframes in ${held_out.parts} parts`]);
  }
  return facts;
}

/** A warning if real and simulated scans disagree, and the real scans that were not asked, with reasons. */
export function RealScans({ disagree = [], left_out = {}, held_out }: RealScansTest) {
  const kept = Object.entries(held_out?.kept_out ?? {}).map(([why, keyframes]) => [`${keyframes} keyframes kept in the map`, why]);
  const reasons = [...Object.entries(left_out), ...kept];
  return (
    <>
      {disagree.length ? (
        <p role="alert">Real and simulated scans disagree ({disagree.join(", ")}): believe the real ones.</p>
      ) : null}
      {reasons.length ? (
        <details>
          <summary>Real scans that were not asked</summary>
          <ul class="lines">
            {reasons.map(([name, why]) => (
              <li key={`${name} ${why}`}>
                {name}: {why}
              </li>
            ))}
          </ul>
        </details>
      ) : null}
    </>
  );
}
