// What the map page shows, from its address and into it: colours, layers, storey and camera. A link restores all of it.

import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";
import { note, route } from "../router";
import { NotedView, viewOf } from "./addressedView";
import { LAYER_NAMES, type LayerName } from "./Layers";
import { type Colouring, COLOURINGS, LARGEST_PX, SIZES_PX } from "./material";
import type { MapScene } from "./scene";

export interface MapState {
  colouring: Signal<Colouring>;
  largestPx: Signal<number>;
  layers: Signal<LayerName[]>;
  storey: Signal<string>; // number from 1; "": all
}

export function useMapState(scene: RefObject<MapScene | null>, isReady: number): MapState {
  const asked = route.value.query;
  const colouring = useSignal(colouringOf(asked));
  const largestPx = useSignal(sizeOf(asked));
  const layers = useSignal(layersOf(asked));
  const storey = useSignal(asked.get("storey") ?? "");
  useEffect(() => {
    colouring.value = colouringOf(asked);
    largestPx.value = sizeOf(asked);
    layers.value = layersOf(asked);
    storey.value = asked.get("storey") ?? "";
  }, [route.value]);
  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    const view = viewOf(asked);
    if (view) here.view = view;
    const noted = new NotedView();
    here.moved = (moved) => noted.moved(moved);
    return () => {
      noted.end();
      here.moved = () => {};
    };
  }, [isReady, route.value]);
  useEffect(() => {
    const size = largestPx.value === LARGEST_PX ? "" : String(largestPx.value);
    note({ colour: colouring.value === "height" ? "" : colouring.value, storey: storey.value, size });
  }, [colouring.value, storey.value, largestPx.value]);
  return { colouring, largestPx, layers, storey };
}

function colouringOf(query: URLSearchParams): Colouring {
  return COLOURINGS.find((one) => one === query.get("colour")) ?? "height";
}

function sizeOf(query: URLSearchParams): number {
  const [least, most] = SIZES_PX;
  const asked = Number(query.get("size"));
  return asked >= least && asked <= most ? asked : LARGEST_PX;
}

function layersOf(query: URLSearchParams): LayerName[] {
  const asked = query.get("layers");
  return asked === null ? ["trajectory"] : LAYER_NAMES.filter((one) => asked.split(",").includes(one));
}
