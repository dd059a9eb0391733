// The 3D picture as a component. Whoever shows it lays marks over it through `ready`.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Problem } from "../api/client";
import { ErrorText } from "../ui/ErrorText";
import { count } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { type Cloud, mark, openCloud, points } from "./cloud";
import { KEYS, MapScene } from "./scene";
import { heightsOf, type Storey, storeysOf } from "./storeys";

export interface CanvasProps {
  map: string;
  version: string;
  ready: (scene: MapScene | null, cloud: Cloud | null, storeys: Storey[]) => void;
  clicked?: (position: [number, number, number]) => void;
  /** A click at a place of the window, before it is taken for one on the cloud. True: it was on something else. */
  clickedAt?: (clientX: number, clientY: number) => boolean;
}

export function MapCanvas({ map, version, ready, clicked, clickedAt }: CanvasProps) {
  const element = useRef<HTMLDivElement>(null);
  const shown = useSignal(0);
  const isBusy = useSignal(true);
  const problem = useSignal<unknown>(null);
  const opened = useLoaded((signal) => open(map, version, signal), [map, version]);
  const cloud = opened.value?.cloud;
  const isMissing = opened.error instanceof Problem && opened.error.status === 404;
  const click = useRef(clicked);
  click.current = clicked;
  const clickAt = useRef(clickedAt);
  clickAt.current = clickedAt;
  useEffect(() => {
    if (!opened.value || !cloud || !element.current) return;
    let scene: MapScene;
    try {
      scene = new MapScene(cloud, element.current);
    } catch (error) {
      problem.value = error;
      return;
    }
    scene.drawn = () => {
      shown.value = scene.shownPoints;
      isBusy.value = scene.isBusy;
    };
    scene.failed = (error) => (problem.value = error);
    const canvas = element.current.querySelector("canvas")!;
    let pressed: [number, number] | null = null;
    const down = (event: PointerEvent) => (pressed = [event.clientX, event.clientY]);
    const up = (event: PointerEvent) => {
      const isClick = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
      pressed = null;
      if (!isClick || event.button !== 0 || clickAt.current?.(event.clientX, event.clientY) || !click.current) return;
      const position = scene.pick(event.clientX, event.clientY);
      if (position) click.current(position);
    };
    canvas.addEventListener("pointerdown", down);
    canvas.addEventListener("pointerup", up);
    showStorey(scene, cloud, opened.value.storeys, null);
    ready(scene, cloud, opened.value.storeys);
    return () => {
      ready(null, null, []);
      scene.dispose();
    };
  }, [opened.value]);
  return (
    <div class="map-canvas" ref={element} data-points={shown.value} aria-busy={isBusy.value}>
      {isMissing ? (
        <p role="status">
          This version has no cloud to show: it is provisional, or was built by an older service. Everything else
          works. The full version of the same build brings one.
        </p>
      ) : opened.error ? (
        <ErrorText error={opened.error} again={opened.again} />
      ) : null}
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {!cloud && !opened.error ? <p role="status">Opening the cloud …</p> : null}
      {cloud ? <p class="keys">{KEYS}</p> : null}
      {cloud ? (
        <p class="shown">
          {count(shown.value)} of {count(cloud.index.points)} points
        </p>
      ) : null}
    </div>
  );
}

/** Draws one storey, or all of them without the uppermost ceiling. */
export function showStorey(scene: MapScene, cloud: Cloud, storeys: Storey[], chosen: Storey | null): void {
  const bounds = cloud.index.bounds_m.map((corner) => scene.local(corner).z) as [number, number];
  const low = chosen?.low ?? bounds[0] - 1;
  const high = Math.min(chosen?.high ?? storeys.at(-1)?.high ?? Infinity, bounds[1] + 1);
  scene.material.slice = [low, high];
  scene.material.floors = storeys.map((one) => one.low);
  scene.material.heights = [Math.max(low, bounds[0]), Math.min(high, bounds[1])];
  scene.redraw();
}

async function open(map: string, version: string, signal: AbortSignal): Promise<{ cloud: Cloud; storeys: Storey[] }> {
  const cloud = await openCloud(map, version, signal);
  const [templates, root] = await Promise.all([
    mark(cloud, "templates", signal),
    points(cloud, cloud.root.first, cloud.root.count, signal),
  ]);
  return { cloud, storeys: storeysOf(heightsOf(templates), root, cloud.index.edge_m) };
}
