// What the map page shows, from its address and into it: colours, layers, storey and camera. A link restores all of it.

import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";
import { note, route } from "../router";
import type { View } from "./framed";
import { LAYER_NAMES, type LayerName } from "./Layers";
import { type Colouring, COLOURINGS } from "./material";
import type { MapScene } from "./scene";

const SETTLED_MS = 300; // after the last movement the camera is noted

export interface MapState {
  colouring: Signal<Colouring>;
  layers: Signal<LayerName[]>;
  storey: Signal<string>; // number from 1; "": all
}

export function useMapState(scene: RefObject<MapScene | null>, isReady: number): MapState {
  const asked = route.value.query;
  const colouring = useSignal(colouringOf(asked));
  const layers = useSignal(layersOf(asked));
  const storey = useSignal(asked.get("storey") ?? "");
  useEffect(() => {
    colouring.value = colouringOf(asked);
    layers.value = layersOf(asked);
    storey.value = asked.get("storey") ?? "";
  }, [route.value]);
  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    const view = viewOf(asked);
    if (view) here.view = view;
    let waiting = 0;
    here.moved = ({ target, eye }) => {
      clearTimeout(waiting);
      waiting = window.setTimeout(() => note({ view: [...target, ...eye].map((m) => m.toFixed(3)).join(",") }), SETTLED_MS);
    };
    return () => {
      clearTimeout(waiting);
      here.moved = () => {};
    };
  }, [isReady, route.value]);
  useEffect(() => {
    note({ colour: colouring.value === "height" ? "" : colouring.value, storey: storey.value });
  }, [colouring.value, storey.value]);
  return { colouring, layers, storey };
}

function colouringOf(query: URLSearchParams): Colouring {
  return COLOURINGS.find((one) => one === query.get("colour")) ?? "height";
}

function layersOf(query: URLSearchParams): LayerName[] {
  const asked = query.get("layers");
  return asked === null ? ["trajectory"] : LAYER_NAMES.filter((one) => asked.split(",").includes(one));
}

function viewOf(query: URLSearchParams): View | null {
  const numbers = query.get("view")?.split(",").map(Number) ?? [];
  if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return null;
  const [x, y, z, ex, ey, ez] = numbers as [number, number, number, number, number, number];
  return { target: [x, y, z], eye: [ex, ey, ez] };
}
