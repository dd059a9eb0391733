// A version that patches another one: its changed areas one by one, the map before and after side by side.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Problem } from "../api/client";
import { mapDetails, versionDetails } from "../api/maps";
import type { Cloud } from "../map3d/cloud";
import { MapCanvas } from "../map3d/MapCanvas";
import { viewOf } from "../map3d/addressedView";
import type { MapScene } from "../map3d/scene";
import { MapProblem } from "../maps/MapProblem";
import { manifestOf, type PatchedArea } from "../maps/manifest";
import { link, note, route } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { PatchPanel } from "./PatchPanel";
import { changedPoints, linked, lookAt, marked, type Side } from "./sides";

const NONE = new Float32Array();

export function PatchView({ map }: { map: string }) {
  const version = route.value.query.get("version") ?? "";
  const details = useLoaded((signal) => versionDetails(map, version, signal), [map, version]);
  const active = useLoaded((signal) => mapDetails(map, signal), [map]);
  const patch = manifestOf(details.value).source?.patch;
  const base = useLoaded((signal) => (patch ? hasBase(map, patch.base, signal) : Promise.resolve(null)), [map, patch]);
  const before = useSignal<Side | null>(null);
  const after = useSignal<Side | null>(null);
  const shown = useSignal(areaOf(route.value.query));
  const areas = patch?.areas ?? [];
  const area = areaAt(areas, shown.value);
  const [old, now] = [before.value, after.value];
  const changed = useLoaded(
    async (signal) => (area && old && now ? { area, ...(await changedPoints(old.cloud, now.cloud, area, signal)) } : null),
    [old, now, area],
  );

  useEffect(() => {
    shown.value = areaOf(route.value.query);
  }, [route.value]);

  useEffect(() => {
    const sides = [old, now].filter((one) => one !== null);
    const view = viewOf(route.value.query);
    const asked = areaAt(areas, areaOf(route.value.query));
    for (const side of sides) {
      if (view) side.scene.view = view;
      else if (asked) lookAt(side, asked);
    }
    return linked(sides);
  }, [old, now, route.value]);

  useEffect(() => {
    if (!area) return;
    const found = changed.value?.area === area ? changed.value : null; // not that of the area before
    const ends = [
      old && marked(old.scene, area, found?.box ?? null, found?.removed ?? NONE, "mark-gone"),
      now && marked(now.scene, area, found?.box ?? null, found?.added ?? NONE, "mark-new"),
    ];
    return () => ends.forEach((end) => end?.());
  }, [old, now, area, changed.value]);

  const choose = (number: number) => {
    shown.value = number;
    note({ area: String(number) });
    const side = now ?? old;
    if (side) lookAt(side, areas[number - 1]!); // the other picture follows
  };

  const error = details.error ?? active.error;
  if (error) return <MapProblem map={map} error={error} again={details.error ? details.again : active.again} />;
  if (!details.value || !active.value) return <p role="status">Reading the version …</p>;
  if (!patch) {
    return (
      <Empty title="This version is no patch">
        <a href={link(["maps", map, "versions"])}>All versions of {map}</a>
      </Empty>
    );
  }
  return (
    <div class="map-view">
      <div class="sides">
        {base.value ? (
          <Picture name="Before" map={map} version={patch.base} side={before} />
        ) : base.value === false ? (
          <p class="hint">The version before is retired, so there is nothing to compare this one with.</p>
        ) : null}
        <Picture name="After" map={map} version={version} side={after} />
      </div>
      <PatchPanel
        map={map}
        version={version}
        active={active.value.active_version ?? ""}
        patch={patch}
        shown={area ? areas.indexOf(area) + 1 : 0}
        choose={choose}
        counts={
          area && changed.value?.area === area
            ? { added: changed.value.added.length / 3, removed: changed.value.removed.length / 3 }
            : null
        }
        again={active.again}
      >
        {base.error ? <ErrorText error={base.error} again={base.again} /> : null}
        {changed.error ? <ErrorText error={changed.error} again={changed.again} /> : null}
      </PatchPanel>
    </div>
  );
}

/** Whether the version before the patch is still there. */
async function hasBase(map: string, base: string, signal: AbortSignal): Promise<boolean> {
  try {
    await versionDetails(map, base, signal);
    return true;
  } catch (error) {
    if (error instanceof Problem && error.code === "not_found") return false;
    throw error;
  }
}

interface PictureProps {
  name: string;
  map: string;
  version: string;
  side: Signal<Side | null>;
}

function Picture({ name, map, version, side }: PictureProps) {
  const ready = (scene: MapScene | null, cloud: Cloud | null) => {
    if (scene) scene.material.colouring = "plain"; // so that the changed points stand out
    side.value = scene && cloud ? { scene, cloud } : null;
  };
  return (
    <figure>
      <figcaption>{name}</figcaption>
      <MapCanvas key={version} map={map} version={version} ready={ready} />
    </figure>
  );
}

/** The area of a number, which is counted from 1. Of a larger number it is the last one. */
function areaAt(areas: readonly PatchedArea[], number: number): PatchedArea | undefined {
  return areas[Math.min(number, areas.length) - 1];
}

/** The number of the area that an address names. */
function areaOf(query: URLSearchParams): number {
  const number = Number(query.get("area") ?? 1);
  return Number.isInteger(number) && number > 0 ? number : 1;
}
