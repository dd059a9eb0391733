// The marks of each layer, from what the service knows about the version.

import { Group, type Object3D } from "three";
import type { MapChanges } from "../api/maps";
import { recordedPage } from "../api/scans";
import { answerOf, placeIn } from "../recorded/place";
import { token } from "../ui/token";
import { colourOf } from "../ui/verdict";
import { type Cloud, mark } from "./cloud";
import { gridMark } from "./gridMark";
import type { LayerName } from "./Layers";
import { cellsMark, dotsMark, onTop, pathMark } from "./marks";
import type { MapScene } from "./scene";
import { aliases, squares } from "./spotMarks";
import type { SpotGrid } from "./spots";

const MAX_QUERIES = 200;
const QUERY_PX = 9;

export type MarkLayer = Exclude<LayerName, "changes">;

/** The marks of a layer; null where there is nothing to show. */
export async function layerOf(
  name: MarkLayer,
  map: string,
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
  if (name === "recorded") return recordedMarks(map, scene, signal);
  if (name === "grid") return gridMark(scene.bulk, scene.origin);
  const positions = await mark(cloud, name, signal);
  if (!positions.length) return null;
  return name === "templates" ? dotsMark(positions, token("mark-template"), 2) : pathMark(positions, token("mark-path"));
}

/** The cells of all areas that have changed or were never mapped. */
export function changeMarks(scene: MapScene, found: MapChanges): Object3D {
  const group = new Group();
  for (const area of found.areas) {
    const corners = (area.cell_list ?? []).map((cell) => scene.local(cell.map((n) => n * found.cell_m)));
    group.add(cellsMark(corners, found.cell_m, token(`mark-${area.kind}`)));
  }
  return group;
}

/** A dot where each recorded query was taken, as far as anybody knows, in the colour of its verdict. */
async function recordedMarks(map: string, scene: MapScene, signal: AbortSignal): Promise<Object3D | null> {
  const { queries } = await recordedPage({ map_id: map, limit: MAX_QUERIES }, signal);
  const group = new Group();
  for (const one of queries) {
    const place = placeIn(one, map);
    if (!place) continue;
    const at = new Float32Array(scene.local(place.position).toArray());
    group.add(onTop(dotsMark(at, colourOf(answerOf(one).verdict), QUERY_PX)));
  }
  return group.children.length ? group : null;
}
