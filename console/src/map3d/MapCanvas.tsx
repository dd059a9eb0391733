// The 3D picture as a component. Whoever shows it lays marks over it through `ready`.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { ErrorText } from "../ui/ErrorText";
import { count } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { type Cloud, openCloud } from "./cloud";
import { MapScene } from "./scene";

export interface CanvasProps {
  map: string;
  version: string;
  ready: (scene: MapScene | null, cloud: Cloud | null) => void;
  clicked?: (position: [number, number, number]) => void;
}

export function MapCanvas({ map, version, ready, clicked }: CanvasProps) {
  const element = useRef<HTMLDivElement>(null);
  const shown = useSignal(0);
  const problem = useSignal<unknown>(null);
  const cloud = useLoaded((signal) => openCloud(map, version, signal), [map, version]);
  const click = useRef(clicked);
  click.current = clicked;
  useEffect(() => {
    if (!cloud.value || !element.current) return;
    let scene: MapScene;
    try {
      scene = new MapScene(cloud.value, element.current);
    } catch (error) {
      problem.value = error;
      return;
    }
    scene.drawn = () => (shown.value = scene.shownPoints);
    scene.failed = (error) => (problem.value = error);
    const canvas = element.current.querySelector("canvas")!;
    let pressed: [number, number] | null = null;
    const down = (event: PointerEvent) => (pressed = [event.clientX, event.clientY]);
    const up = (event: PointerEvent) => {
      const isClick = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
      pressed = null;
      if (!isClick || event.button !== 0 || !click.current) return;
      const position = scene.pick(event.clientX, event.clientY);
      if (position) click.current(position);
    };
    canvas.addEventListener("pointerdown", down);
    canvas.addEventListener("pointerup", up);
    ready(scene, cloud.value);
    return () => {
      ready(null, null);
      scene.dispose();
    };
  }, [cloud.value]);
  return (
    <div class="map-canvas" ref={element} data-points={shown.value}>
      {cloud.error ? <ErrorText error={cloud.error} again={cloud.again} /> : null}
      {problem.value ? <ErrorText error={problem.value} /> : null}
      {!cloud.value && !cloud.error ? <p role="status">Opening the cloud …</p> : null}
      <p class="shown">
        {count(shown.value)} of {count(cloud.value?.index.points ?? 0)} points
      </p>
    </div>
  );
}
