// One map: its cloud, what is known about it, and the layers that can be laid over it.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group, type Object3D } from "three";
import { get, type Schemas } from "../api/client";
import { note, route } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { ChangesPanel } from "./ChangesPanel";
import type { Cloud } from "./cloud";
import { Layers, type LayerName } from "./Layers";
import { changeMarks, layerOf } from "./layerMarks";
import { MapCanvas, showStorey } from "./MapCanvas";
import type { Colouring } from "./material";
import { Measure } from "./measure";
import { clear, type MapScene } from "./scene";
import { ShareLink } from "./ShareLink";
import { chosen } from "./spotMarks";
import { SpotPanel } from "./SpotPanel";
import type { SpotCell } from "./spots";
import type { Storey } from "./storeys";
import { useSpotGrid } from "./useSpotGrid";

const MOST_AREAS = 1000;

export function MapView({ map }: { map: string }) {
  const asked = route.value.query;
  const details = useLoaded(
    (signal) => get<Schemas["MapDetails"]>(`/maps/${map}`, {}, signal),
    [map],
  );
  const version = asked.get("version") || details.value?.active_version || "";
  const scene = useRef<MapScene | null>(null);
  const cloud = useRef<Cloud | null>(null);
  const isReady = useSignal(0);
  const colouring = useSignal<Colouring>((asked.get("colour") as Colouring) || "height");
  const layers = useSignal<LayerName[]>((asked.get("layers")?.split(",") as LayerName[]) ?? ["trajectory"]);
  const storeys = useSignal<Storey[]>([]);
  const storey = useSignal(asked.get("storey") ?? "");
  const measuring = useSignal(false);
  const measure = useRef<Measure | null>(null);
  const length = useSignal<number | null>(null);
  const problem = useSignal<unknown>(null);
  const grid = useSpotGrid(map, version, cloud);
  const spot = useSignal<SpotCell | null>(null);
  const isCompared = layers.value.includes("changes");
  const changes = useLoaded(
    async (signal) =>
      isCompared && version
        ? await get<Schemas["MapChanges"]>(`/maps/${map}/changes`, { version, cells: true, limit: MOST_AREAS }, signal)
        : null,
    [map, version, isCompared],
  );
  const isTested = layers.value.includes("localizability") || layers.value.includes("aliases");

  const opened = (found: MapScene | null, with_: Cloud | null, its: Storey[]) => {
    scene.current = found;
    cloud.current = with_;
    storeys.value = its;
    isReady.value += 1;
    if (!found || !with_) return;
    const eye = asked.get("view")?.split(",").map(Number);
    if (eye?.length === 6 && eye.every(Number.isFinite)) {
      found.view = {
        target: eye.slice(0, 3) as [number, number, number],
        eye: eye.slice(3) as [number, number, number],
      };
    }
    let waiting = 0;
    found.moved = ({ target, eye: at }) => {
      clearTimeout(waiting);
      waiting = window.setTimeout(() => note({ view: [...target, ...at].map((v) => v.toFixed(2)).join(",") }), 300);
    };
    measure.current = new Measure(found, (m) => (length.value = m));
  };

  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    here.material.colouring = colouring.value;
    showStorey(here, cloud.current!, storeys.value, storeys.value[Number(storey.value) - 1] ?? null);
    note({ colour: colouring.value === "height" ? "" : colouring.value, storey: storey.value });
  }, [isReady.value, colouring.value, storey.value]);

  useEffect(() => {
    const here = scene.current;
    if (!here || !cloud.current) return;
    const stop = new AbortController();
    const group = new Group();
    const remove = laid(here, group);
    note({ layers: layers.value.join(",") });
    for (const name of layers.value) {
      if (name === "changes") continue;
      layerOf(name, here, cloud.current, grid.load, stop.signal)
        .then((found) => {
          if (stop.signal.aborted || !found) return;
          group.add(found);
          here.redraw();
        })
        .catch((error: unknown) => {
          if (!stop.signal.aborted) problem.value = error;
        });
    }
    return () => {
      stop.abort();
      remove();
    };
  }, [isReady.value, layers.value, version]);

  useEffect(() => {
    const here = scene.current;
    if (!here || !isTested || !grid.value || !spot.value) return;
    return laid(here, chosen(here, grid.value, spot.value));
  }, [isReady.value, grid.value, spot.value, isTested]);

  useEffect(() => {
    const here = scene.current;
    if (!here || !changes.value) return;
    return laid(here, changeMarks(here, changes.value));
  }, [isReady.value, changes.value]);

  const clicked = (position: [number, number, number]) => {
    if (measuring.value) measure.current?.add(position);
    else if (isTested) spot.value = grid.value?.at(position) ?? null;
  };

  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  if (!details.value) return <p role="status">Opening {map} …</p>;
  if (!version) return <p>The map {map} has no active version.</p>;
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
        <Layers
          colouring={colouring}
          layers={layers}
          storeys={storeys.value}
          storey={storey}
          whole={() => scene.current?.lookAtAll()}
        />
        {isTested && grid.value ? (
          <SpotPanel grid={grid.value} chosen={spot.value} choose={(one) => (spot.value = one)} />
        ) : null}
        {changes.value ? (
          <ChangesPanel found={changes.value} look={(position) => scene.current?.lookAt(position)} />
        ) : null}
        {changes.error ? <ErrorText error={changes.error} again={changes.again} /> : null}
        <ShareLink version={version} />
        <section>
          <h3>Measure</h3>
          <label class="check">
            <input
              type="checkbox"
              checked={measuring.value}
              onChange={(event) => {
                measuring.value = event.currentTarget.checked;
                measure.current?.clear();
              }}
            />
            Click two points
          </label>
          {length.value === null ? null : <output>{length.value.toFixed(3)} m</output>}
        </section>
        {problem.value ? <ErrorText error={problem.value} /> : null}
      </aside>
    </div>
  );
}

/** Lays a mark over the picture. Returns what removes it. */
function laid(scene: MapScene, mark: Object3D): () => void {
  scene.overlay.add(mark);
  scene.redraw();
  return () => {
    clear(mark);
    scene.overlay.remove(mark);
    scene.redraw();
  };
}
