// The way to the view that shows what a patch has changed.

import { versionDetails } from "../api/maps";
import { manifestOf } from "../maps/manifest";
import { link } from "../router";
import { useLoaded } from "../ui/useLoaded";

export function patchAddress(map: string, version: string): string {
  return link(["maps", map, "patch"], { version });
}

/** A link to what a version has changed, if it is a patch. */
export function PatchLink({ map, version }: { map: string; version: string }) {
  const details = useLoaded((signal) => versionDetails(map, version, signal), [map, version]);
  return manifestOf(details.value).source?.patch ? <a href={patchAddress(map, version)}>Before and after</a> : null;
}
