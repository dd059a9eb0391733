// Keeps the chosen layers laid over the picture, and says which of them have nothing to show.

import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";
import { Group, type Object3D } from "three";
import { note } from "../router";
import type { Cloud } from "./cloud";
import type { LayerName } from "./Layers";
import { layerOf } from "./layerMarks";
import { clear } from "./clear";
import type { MapScene } from "./scene";
import type { SpotGrid } from "./spots";

export function useLayerMarks(
  map: string,
  scene: RefObject<MapScene | null>,
  cloud: RefObject<Cloud | null>,
  isReady: number,
  version: string,
  layers: LayerName[],
  grid: () => Promise<SpotGrid>,
  problem: Signal<unknown>,
): LayerName[] {
  const empty = useSignal<LayerName[]>([]);
  useEffect(() => {
    const here = scene.current;
    if (!here || !cloud.current) return;
    const stop = new AbortController();
    const group = new Group();
    const remove = laid(here, group);
    empty.value = [];
    note({ layers: layers.join(",") });
    for (const name of layers) {
      if (name === "changes") continue;
      layerOf(name, map, here, cloud.current, grid, stop.signal)
        .then((found) => {
          if (stop.signal.aborted) return;
          if (!found) {
            empty.value = [...empty.value, name];
            return;
          }
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
  }, [isReady, layers, version]);
  return empty.value;
}

/** Lays a mark over the picture. Returns what removes it. */
export function laid(scene: MapScene, mark: Object3D): () => void {
  scene.overlay.add(mark);
  scene.redraw();
  return () => {
    clear(mark);
    scene.overlay.remove(mark);
    scene.redraw();
  };
}
