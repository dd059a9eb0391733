// The marks of each layer, from what the service knows about the version.

import { Group, type Object3D } from "three";
import type { Schemas } from "../api/client";
import { type Cloud, mark } from "./cloud";
import type { LayerName } from "./Layers";
import { cellsMark, dotsMark, pathMark } from "./marks";
import type { MapScene } from "./scene";
import { aliases, squares } from "./spotMarks";
import type { SpotGrid } from "./spots";

const GONE = 0xff3b30; // style.css has both for the key
const NEW = 0x34c759;

export type MarkLayer = Exclude<LayerName, "changes">;

/** The marks of a layer; null where there is nothing to show. */
export async function layerOf(
  name: MarkLayer,
  scene: MapScene,
  cloud: Cloud,
  grid: () => Promise<SpotGrid>,
  signal: AbortSignal,
): Promise<Object3D | null> {
  if (name === "localizability" || name === "aliases") {
    const tested = await grid();
    if (name === "aliases") return tested.confused.length ? aliases(scene, tested) : null;
    return tested.cells.length ? squares(scene, tested) : null;
  }
  const positions = await mark(cloud, name, signal);
  if (!positions.length) return null;
  return name === "templates" ? dotsMark(positions, 0x7b8794, 2) : pathMark(positions, 0xff9500);
}

/** The cells of all areas that have changed. */
export function changeMarks(scene: MapScene, found: Schemas["MapChanges"]): Object3D {
  const group = new Group();
  for (const area of found.areas) {
    const corners = (area.cell_list ?? []).map((cell) => scene.local(cell.map((n) => n * found.cell_m)));
    group.add(cellsMark(corners, found.cell_m, area.kind === "gone" ? GONE : NEW));
  }
  return group;
}
