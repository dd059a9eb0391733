// A scan that nobody took: what a sensor would see of the map's points from a spot. Good enough to try a map with.

import { type Cloud, type CloudNode, mapPositions, mark, openCloud, points } from "../map3d/cloud";
import type { Asked } from "./asked";

export interface ExampleSensor {
  max_range_m: number;
  azimuth_cells: number;
  elevations_deg: [number, number]; // the lowest and the highest ray
}

const USUAL: ExampleSensor = { max_range_m: 60, azimuth_cells: 360, elevations_deg: [-45, 45] };
const CELL_DEG = 1;
const MIN_RANGE_M = 0.3;
const MAX_POINTS = 600_000; // that are read for one scan
const FINEST_M = 0.05;
const XYZ = "application/vnd.firstfix.xyz";

/** Simulates a level scan at a spot of the map's frame; null: at a template in the middle of the list. */
export async function simulatedScan(
  map: string,
  version: string,
  spot: readonly number[] | null,
  signal: AbortSignal,
): Promise<Asked> {
  const cloud = await openCloud(map, version, signal);
  // whole millimetres, as a link has them: the same scan comes of it
  const at = (await spotOf(cloud, spot, signal)).map((m) => Math.round(m * 1000) / 1000);
  const found = await pointsAround(cloud, at, USUAL.max_range_m, signal);
  const seen = nearestOfEachRay(found, at, USUAL);
  if (!seen.length) throw new Error("Nothing of the map is within 60 m of this spot. Click nearer to its points.");
  const name = `Simulated at ${at.map((m) => m.toFixed(2)).join(", ")} m`;
  return { name, type: XYZ, encoding: "", body: new Blob([seen]), spot: spot ?? at };
}

/** A spot where a sensor of this map may stand. One that was clicked lies on a surface: it gets the height of the place next to it. */
async function spotOf(cloud: Cloud, spot: readonly number[] | null, signal: AbortSignal): Promise<number[]> {
  for (const name of ["templates", "trajectory"]) {
    if (!cloud.index.marks[name]?.[1]) continue;
    const places = mapPositions(cloud, await mark(cloud, name, signal));
    let next = 3 * Math.floor(places.length / 6);
    const away = (i: number) => Math.hypot(...spot!.map((m, axis) => m - places[i + axis]!));
    for (let i = 0; spot && i < places.length; i += 3) if (away(i) < away(next)) next = i;
    const place = [...places.subarray(next, next + 3)];
    return spot ? [spot[0]!, spot[1]!, place[2]!] : place;
  }
  if (spot) return [...spot];
  throw new Error("This version does not say where its sensor stood. Click a spot on the map.");
}

/** Points within a range, coarse ones first, as many as may be read. Positions in the map's frame. */
async function pointsAround(cloud: Cloud, at: readonly number[], range_m: number, signal: AbortSignal): Promise<Float64Array[]> {
  const found: Float64Array[] = [];
  let row: CloudNode[] = [cloud.root];
  let read = 0;
  while (row.length) {
    const next: CloudNode[] = [];
    for (const node of row) {
      if (read + node.count > MAX_POINTS) return found;
      read += node.count;
      found.push(unpacked(cloud, node, await points(cloud, node.first, node.count, signal)));
      if (node.edge > FINEST_M) next.push(...node.children.filter((one) => distance(cloud, one, at) < range_m));
    }
    row = next.sort((a, b) => distance(cloud, a, at) - distance(cloud, b, at));
  }
  return found;
}

function unpacked(cloud: Cloud, node: CloudNode, data: ArrayBuffer): Float64Array {
  const packed = new Uint16Array(data);
  const found = new Float64Array(3 * node.count);
  for (let i = 0; i < node.count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      found[3 * i + axis] = cloud.index.low_m[axis]! + node.low[axis]! + (packed[4 * i + axis]! * node.edge) / 65535;
    }
  }
  return found;
}

/** From a position to the nearest point of a node's cube. */
function distance(cloud: Cloud, node: CloudNode, at: readonly number[]): number {
  const away = at.map((m, axis) => {
    const low = cloud.index.low_m[axis]! + node.low[axis]!;
    return Math.max(low - m, 0, m - low - node.edge);
  });
  return Math.hypot(...away);
}

/** The nearest point of each cell of a range image: what lies behind it is hidden. In the sensor's frame. */
export function nearestOfEachRay(clouds: Float64Array[], at: readonly number[], sensor: ExampleSensor): Float32Array<ArrayBuffer> {
  const [lowest, highest] = sensor.elevations_deg;
  const rows = Math.ceil((highest - lowest) / CELL_DEG);
  const ranges = new Float64Array(rows * sensor.azimuth_cells).fill(Infinity);
  const ends = new Float32Array(3 * ranges.length);
  for (const cloud of clouds) {
    for (let i = 0; i < cloud.length; i += 3) {
      const [x, y, z] = [cloud[i]! - at[0]!, cloud[i + 1]! - at[1]!, cloud[i + 2]! - at[2]!];
      const range = Math.hypot(x, y, z);
      if (range < MIN_RANGE_M || range > sensor.max_range_m) continue;
      const row = Math.floor(((Math.asin(z / range) * 180) / Math.PI - lowest) / CELL_DEG);
      if (row < 0 || row >= rows) continue;
      const column = Math.floor((Math.atan2(y, x) / (2 * Math.PI) + 1) * sensor.azimuth_cells) % sensor.azimuth_cells;
      const cell = row * sensor.azimuth_cells + column;
      if (range >= ranges[cell]!) continue;
      ranges[cell] = range;
      ends.set([x, y, z], 3 * cell);
    }
  }
  const seen: number[] = [];
  ranges.forEach((range, cell) => Number.isFinite(range) && seen.push(...ends.subarray(3 * cell, 3 * cell + 3)));
  return new Float32Array(seen);
}
