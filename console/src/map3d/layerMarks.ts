// The marks of each layer, from what the service knows about the version.

import { Color, Group, type Object3D } from "three";
import { get, type Schemas } from "../api/client";
import { type Cloud, mark } from "./cloud";
import type { LayerName } from "./Layers";
import { cellsMark, dotsMark, pathMark, squareMark } from "./marks";
import type { MapScene } from "./scene";

/** One cell of the self-test's grid. */
export interface SpotCell {
  cell: [number, number];
  scans: number;
  localized: number;
  wrong: number;
  taken_for: [number, number] | null;
}

const SPOT_CELL_M = 4;

/** The marks of a layer; null where there is nothing to show. */
export async function layerOf(
  name: LayerName,
  scene: MapScene,
  cloud: Cloud,
  map: string,
  version: string,
  signal: AbortSignal,
): Promise<Object3D | null> {
  if (name === "trajectory" || name === "templates") {
    const positions = await mark(cloud, name, signal);
    if (!positions.length) return null;
    return name === "templates" ? dotsMark(positions, 0x7b8794, 2) : pathMark(positions, 0xff9500);
  }
  if (name === "localizability") {
    const details = await get<Schemas["VersionDetails"]>(`/maps/${map}/versions/${version}`, {}, signal);
    const report = await get<Schemas["VersionReport"]>(`/maps/${map}/versions/${version}/report`, {}, signal);
    return spots(
      scene,
      (report.self_test.localizability ?? []) as SpotCell[],
      (details.manifest.origin ?? [0, 0, 0]) as number[],
      cloud.index.bounds_m[0][2],
    );
  }
  return changes(scene, await get<Schemas["MapChanges"]>(`/maps/${map}/changes`, { version }, signal));
}

/** Where the self-test stood: green where scans were localized, red where they were not; lines to what they resemble. */
function spots(scene: MapScene, found: SpotCell[], origin: number[], floor: number): Object3D {
  const group = new Group();
  const middle = ([i, j]: [number, number]) =>
    scene.local([(i + 0.5) * SPOT_CELL_M + origin[0]!, (j + 0.5) * SPOT_CELL_M + origin[1]!, floor]);
  for (const one of found) {
    const share = one.localized / one.scans;
    const colour = new Color(1 - share, 0.15 + 0.6 * share, 0.2).getHex();
    group.add(squareMark(middle(one.cell), 0.92 * SPOT_CELL_M, colour));
    const rival = one.taken_for;
    if (!rival || one.localized === one.scans || (rival[0] === one.cell[0] && rival[1] === one.cell[1])) continue;
    group.add(pathMark(new Float32Array([...middle(one.cell).toArray(), ...middle(rival).toArray()]), 0xff9500));
  }
  return group;
}

function changes(scene: MapScene, found: Schemas["MapChanges"]): Object3D | null {
  const group = new Group();
  for (const area of found.areas) {
    const corners = (area.cell_list ?? []).map((cell) => scene.local(cell.map((n) => n * found.cell_m)));
    if (corners.length) group.add(cellsMark(corners, found.cell_m, area.kind === "gone" ? 0xff3b30 : 0x34c759));
  }
  return group;
}
