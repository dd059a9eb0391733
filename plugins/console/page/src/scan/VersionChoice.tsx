// The version that answers: a recorded query can be asked again of another one.

import { versionPage } from "../api/maps";
import { addressed, go, route } from "../router";
import { age, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

export function VersionChoice({ map, active }: { map: string; active: string }) {
  const page = useLoaded(
    (signal) => versionPage(map, signal),
    [map],
  );
  if ((page.value?.versions.length ?? 0) < 2) return null;
  const query = route.value.query;
  const choose = (version: string) => {
    const changed = addressed();
    changed.delete("place"); // each version numbers its own
    version ? changed.set("version", version) : changed.delete("version");
    go(route.value.path, Object.fromEntries(changed));
  };
  return (
    <label>
      Version
      <select value={query.get("version") ?? ""} onChange={(event) => choose(event.currentTarget.value)}>
        <option value="">{short(active)}, the active one</option>
        {page.value!.versions
          .filter((one) => one.version !== active)
          .map((one) => (
            <option key={one.version} value={one.version}>
              {short(one.version)}, {age(one.published_time)}
              {one.provisional ? ", provisional" : ""}
            </option>
          ))}
      </select>
    </label>
  );
}
