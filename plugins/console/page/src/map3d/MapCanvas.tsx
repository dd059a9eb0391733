// The 3D picture as a component. Whoever shows it lays marks over it through `ready`.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Problem } from "../api/client";
import { ErrorText } from "../ui/ErrorText";
import { count } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { type Cloud, mark, openCloud, points } from "./cloud";
import { bulkOf, type Box } from "./bulk";
import { type Floor, floorOf } from "./floor";
import { Keys } from "./Keys";
import type { Colouring } from "./material";
import type { Orientation } from "./orientation";
import { PointLegend } from "./PointLegend";
import { Scale } from "./Scale";
import { MapScene } from "./scene";
import { heightsOf, type Storey, storeysOf } from "./storeys";

type Position = [number, number, number];
const MOUSE_RESTS_MS = 60; // before the point below it is sought

export interface CanvasProps {
  map: string;
  version: string;
  ready: (scene: MapScene | null, cloud: Cloud | null, storeys: Storey[]) => void;
  clicked?: (position: Position) => void;
  /** A click at a place of the window, before it is taken for one on the cloud. True: it was on something else. */
  clickedAt?: (clientX: number, clientY: number) => boolean;
}

export function MapCanvas({ map, version, ready, clicked, clickedAt }: CanvasProps) {
  const element = useRef<HTMLDivElement>(null);
  const shown = useSignal(0);
  const isBusy = useSignal(true);
  const orientation = useSignal<Orientation | null>(null);
  const colouring = useSignal<Colouring>("plain");
  const isAsked = useSignal(false); // for the list of keys
  const under = useSignal<Position | null>(null); // the mouse
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
      scene = new MapScene(cloud, opened.value.bulk, element.current);
    } catch (error) {
      problem.value = error;
      return;
    }
    scene.drawn = () => {
      shown.value = scene.points.shown;
      isBusy.value = scene.isBusy;
      orientation.value = scene.orientation;
      colouring.value = scene.material.colouring;
    };
    scene.keysAsked = () => (isAsked.value = true);
    scene.material.setFloor(opened.value.floor, cloud.index.edge_m);
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
    const unwatch = watchMouse(canvas, (x, y) => (under.value = x === null ? null : scene.pick(x, y)));
    canvas.addEventListener("pointerdown", down);
    canvas.addEventListener("pointerup", up);
    showStorey(scene, cloud, opened.value.storeys, null);
    ready(scene, cloud, opened.value.storeys);
    return () => {
      unwatch();
      ready(null, null, []);
      scene.dispose();
    };
  }, [opened.value]);
  return (
    <div class="map-canvas" ref={element} data-points={shown.value} aria-busy={isBusy.value}>
      {isMissing ? (
        <p class="empty" role="status">
          This version has no points to show. Where it is provisional, the full version of the same build brings them; an
          older one has to be built again. Everything else works.
        </p>
      ) : opened.error ? (
        <ErrorText error={opened.error} again={opened.again} />
      ) : null}
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {!cloud && !opened.error ? <p role="status">Opening the cloud …</p> : null}
      {cloud ? (
        <div class="shown">
          <PointLegend colouring={colouring.value} high={opened.value!.floor.high} intensity={cloud.index.intensity} />
          {orientation.value ? <Scale orientation={orientation.value} /> : null}
          {under.value ? <p class="under-mouse">{under.value.map((m) => m.toFixed(2)).join(", ")} m</p> : null}
          <p>
            {count(shown.value)} of {count(cloud.index.points)} points
          </p>
        </div>
      ) : null}
      {cloud ? <Keys isAsked={isAsked} /> : null}
    </div>
  );
}

/** Says where the mouse has come to rest over the canvas; null: it has left. Returns what ends it. */
function watchMouse(canvas: HTMLCanvasElement, rests: (x: number | null, y: number) => void): () => void {
  let timer = 0;
  const moved = ({ buttons, clientX, clientY }: PointerEvent) => {
    clearTimeout(timer);
    if (!buttons) timer = window.setTimeout(() => rests(clientX, clientY), MOUSE_RESTS_MS);
  };
  const left = () => {
    clearTimeout(timer);
    rests(null, 0);
  };
  canvas.addEventListener("pointermove", moved);
  canvas.addEventListener("pointerleave", left);
  return () => {
    clearTimeout(timer);
    canvas.removeEventListener("pointermove", moved);
    canvas.removeEventListener("pointerleave", left);
  };
}

/** Draws one storey, or all of them without the uppermost ceiling. */
export function showStorey(scene: MapScene, cloud: Cloud, storeys: Storey[], chosen: Storey | null): void {
  const bounds = cloud.index.bounds_m.map((corner) => scene.local(corner).z) as [number, number];
  const low = chosen?.low ?? bounds[0] - 1;
  const high = Math.min(chosen?.high ?? storeys.at(-1)?.high ?? Infinity, bounds[1] + 1);
  scene.material.slice = [low, high];
  scene.material.floors = storeys.map((one) => one.low);
  scene.redraw();
}

interface Opened {
  cloud: Cloud;
  storeys: Storey[];
  floor: Floor;
  bulk: Box;
}

async function open(map: string, version: string, signal: AbortSignal): Promise<Opened> {
  const cloud = await openCloud(map, version, signal);
  const [templates, root] = await Promise.all([
    mark(cloud, "templates", signal),
    points(cloud, cloud.root.first, cloud.root.count, signal),
  ]);
  const edge = cloud.index.edge_m;
  const storeys = storeysOf(heightsOf(templates), root, edge);
  return { cloud, storeys, floor: floorOf(root, edge, storeys), bulk: bulkOf(cloud, root, templates) };
}
