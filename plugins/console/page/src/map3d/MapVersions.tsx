import { versionPage } from "../api/maps";
import { PatchLink } from "../patch/PatchLink";
import { link } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { age, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

const LISTED = 4;
const NEWEST = 100; // that are read: the active one may be an older one

export interface MapVersionsProps {
  map: string;
  version: string; // that is shown
  show: (version: string) => void;
}

/** The newest versions of the map; each can be looked at. */
export function MapVersions({ map, version, show }: MapVersionsProps) {
  const page = useLoaded((signal) => versionPage(map, signal, NEWEST), [map]);
  if (page.error) return <ErrorText error={page.error} again={page.again} />;
  const all = page.value?.versions ?? [];
  const listed = all.filter((one, i) => i < LISTED || one.active || one.version === version);
  return (
    <section aria-label="Versions of the map">
      <h3>Versions</h3>
      <ul class="lines">
        {listed.map((one) => (
          <li key={one.version}>
            <button aria-pressed={one.version === version} title={one.version} onClick={() => show(one.version)}>
              <code>{short(one.version)}</code>
            </button>{" "}
            {age(one.published_time)} {one.active ? <span class="tag on">active</span> : null}{" "}
            {one.provisional ? <span class="tag">provisional</span> : null} <PatchLink map={map} version={one.version} />
          </li>
        ))}
      </ul>
      <a href={link(["maps", map, "versions"])}>{all.length > 1 ? "Compare, activate, roll back" : "Its versions"}</a>
    </section>
  );
}
