// One map: its cloud, what is known about it, and the layers that can be laid over it.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { mayBuild } from "../access/session";
import { mapChanges, mapDetails } from "../api/maps";
import { MapBuilds } from "../maps/MapBuilds";
import { MapProblem } from "../maps/MapProblem";
import { addressed, go, link, route } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { ChangesPanel } from "./ChangesPanel";
import type { Cloud } from "./cloud";
import { gridStep } from "./gridStep";
import { HeatLegend } from "./HeatLegend";
import { isGreyBelow, Layers } from "./Layers";
import { changeMarks } from "./layerMarks";
import { MapCanvas, showStorey } from "./MapCanvas";
import { Measure } from "./measure";
import { MeasureTool } from "./MeasureTool";
import { MapQueries } from "./MapQueries";
import { MapVersions } from "./MapVersions";
import { Quality } from "./Quality";
import type { MapScene } from "./scene";
import { ShareLink } from "./ShareLink";
import { ViewerFiles } from "./ViewerFiles";
import { chosen } from "./spotMarks";
import { SpotPanel } from "./SpotPanel";
import type { SpotCell } from "./spots";
import type { Storey } from "./storeys";
import { laid, useLayerMarks } from "./useLayerMarks";
import { useMapState } from "./useMapState";
import { useSpotGrid } from "./useSpotGrid";

const MAX_AREAS = 1000;

export function MapView({ map }: { map: string }) {
  const asked = route.value.query;
  const details = useLoaded((signal) => mapDetails(map, signal), [map]);
  const version = asked.get("version") || details.value?.active_version || "";
  const scene = useRef<MapScene | null>(null);
  const cloud = useRef<Cloud | null>(null);
  const isReady = useSignal(0);
  const { colouring, largestPx, layers, storey } = useMapState(scene, isReady.value);
  const storeys = useSignal<Storey[]>([]);
  const measuring = useSignal(false);
  const measure = useRef<Measure | null>(null);
  const length = useSignal<number | null>(null);
  const problem = useSignal<unknown>(null);
  const grid = useSpotGrid(map, version, cloud);
  const spot = useSignal<SpotCell | null>(null);
  const isCompared = layers.value.includes("changes");
  const changes = useLoaded(
    async (signal) => (version ? await mapChanges(map, { version, cells: isCompared, limit: MAX_AREAS }, signal) : null),
    [map, version, isCompared],
  );
  const isHeated = layers.value.includes("localizability");
  const isGrey = isGreyBelow(layers.value);
  const isTested = isHeated || layers.value.includes("aliases");

  const opened = (found: MapScene | null, with_: Cloud | null, its: Storey[]) => {
    scene.current = found;
    cloud.current = with_;
    storeys.value = its;
    isReady.value += 1;
    if (!found || !with_) return;
    if (colouring.value === "intensity" && !with_.index.intensity) colouring.value = "height"; // a link from another version
    measure.current = new Measure(found, (m) => (length.value = m));
  };

  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    here.material.colouring = isGrey ? "plain" : colouring.value;
    here.material.largestPx = largestPx.value;
    showStorey(here, cloud.current!, storeys.value, storeys.value[Number(storey.value) - 1] ?? null);
  }, [isReady.value, isGrey, colouring.value, largestPx.value, storey.value]);

  const empty = useLayerMarks(map, scene, cloud, isReady.value, version, layers.value, grid.load, problem);

  useEffect(() => {
    const here = scene.current;
    if (!here || !isTested || !grid.value || !spot.value) return;
    return laid(here, chosen(here, grid.value, spot.value));
  }, [isReady.value, grid.value, spot.value, isTested]);

  useEffect(() => {
    const here = scene.current;
    if (!here || !changes.value || !isCompared) return;
    return laid(here, changeMarks(here, changes.value));
  }, [isReady.value, changes.value, isCompared]);

  const lookAtChange = (position: readonly number[], away: number) => {
    if (!isCompared) layers.value = [...layers.value, "changes"];
    scene.current?.lookAt(position, away);
  };

  const clicked = (position: [number, number, number]) => {
    if (measuring.value) measure.current?.add(position);
    else if (isTested) spot.value = grid.value?.at(position) ?? null;
  };

  const builds = <MapBuilds map={map} active={details.value?.active_version ?? null} done={details.again} />;
  if (details.error) {
    return (
      <MapProblem map={map} error={details.error} again={details.again}>
        {builds}
      </MapProblem>
    );
  }
  if (!details.value) return <p role="status">Opening {map} …</p>;
  if (!version) {
    return (
      <Empty title={`${map} has no active version`}>
        <p>All its versions are retired. Build it anew, or activate one.</p>
        {builds}
        <a href={link(["maps", map, "versions"])}>Its versions</a>
      </Empty>
    );
  }
  return (
    <div class="map-view">
      <MapCanvas
        key={version}
        map={map}
        version={version}
        ready={opened}
        clicked={clicked}
      />
      <aside class="panel" aria-label="Layers and tools">
        <h1>{map}</h1>
        {builds}
        <Quality
          map={map}
          version={version}
          showHeat={isHeated ? null : () => (layers.value = [...layers.value, "localizability"])}
        />
        <Layers
          colouring={colouring}
          largestPx={largestPx}
          layers={layers}
          empty={empty}
          gridM={layers.value.includes("grid") && scene.current ? gridStep(scene.current.bulk) : null}
          hasIntensity={cloud.current?.index.intensity != null}
          storeys={storeys.value}
          storey={storey}
          whole={() => scene.current?.lookAtAll()}
          above={() => scene.current?.lookFromAbove()}
        />
        {isHeated ? <HeatLegend hasCrosses={grid.value?.cells.some((one) => one.in_part) ?? false} /> : null}
        {isTested && grid.value ? (
          <SpotPanel grid={grid.value} chosen={spot.value} choose={(one) => (spot.value = one)} />
        ) : null}
        {changes.value ? <ChangesPanel found={changes.value} look={lookAtChange} /> : null}
        {changes.error ? <ErrorText error={changes.error} again={changes.again} /> : null}
        <MapVersions
          key={details.value.active_version}
          map={map}
          version={version}
          show={(one) => go(["maps", map], { ...Object.fromEntries(addressed()), version: one })}
        />
        {mayBuild.value ? <MapQueries map={map} /> : null}
        <ShareLink version={version} />
        <ViewerFiles map={map} version={version} />
        <MeasureTool measuring={measuring} length={length} clear={() => measure.current?.clear()} />
        {problem.value ? <ErrorText error={problem.value} /> : null}
      </aside>
    </div>
  );
}
