// Is this version good? What its self-test says, what it was made of, and where to look next.

import { get, type Schemas } from "../api/client";
import { bytesOf, extentOf, judged, type Manifest, manifestOf } from "../maps/manifest";
import { link } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { count, percent, size } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

export function Quality({ map, version }: { map: string; version: string }) {
  const details = useLoaded(
    (signal) => get<Schemas["VersionDetails"]>(`/maps/${map}/versions/${version}`, {}, signal),
    [map, version],
  );
  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  if (!details.value) return <p role="status">Reading the self-test …</p>;
  const manifest = manifestOf(details.value);
  const { grade, text } = judged(manifest);
  return (
    <section aria-label="Is it good?">
      <p>
        <strong class={`grade ${grade}`}>{grade}</strong> {details.value.active ? null : <span class="tag">not active</span>}{" "}
        {text}
      </p>
      <dl class="facts">
        {factsOf(manifest).map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      <a href={link(["maps", map, "try"], details.value.active ? {} : { version })}>Try a scan in it</a>
    </section>
  );
}

function factsOf(manifest: Manifest): [string, string][] {
  const { self_test: test, counts = {}, sensor } = manifest;
  const facts: [string, string | null][] = [
    ["Localized in its self-test", test?.localized === undefined ? null : `${percent(test.localized)} of ${test.queries ?? "its"} scans`],
    ["Sure and wrong", test?.false_accepts === undefined ? null : String(test.false_accepts)],
    ["Best place within 0.2 m", test?.success?.["0.2m"] === undefined ? null : percent(test.success["0.2m"])],
    ["Median error", (test?.median_error_m ?? -1) >= 0 ? `${(100 * test!.median_error_m!).toFixed(1)} cm` : null],
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
