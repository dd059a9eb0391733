// The floor of each storey as a grid of heights, from the lowest points: height above it colours the points.

import type { Storey } from "./storeys";

export const FLOOR_CELLS = 32; // along each edge of the cloud
const LOW_SHARE = 0.1; // of a cell's points that may lie below the floor: strays and pits
const MIN = 4; // points of a cell that tell a floor
const HIGH_SHARE = 0.97; // of the points that are at most as high as the colours reach
const MIN_HIGH_M = 2;
const POINT_BYTES = 8;

export interface Floor {
  heights: Float32Array; // metres from the cloud's low corner; storey by storey, row by row
  high: number; // metres above the floor that the colours reach
}

/** `root` holds the points of the cloud's root, whose edge is given. */
export function floorOf(root: ArrayBuffer, edge: number, storeys: Storey[]): Floor {
  const points = new DataView(root);
  const layers = storeys.length ? storeys : [{ name: "", low: -Infinity, high: Infinity }];
  const heights = new Float32Array(layers.length * FLOOR_CELLS ** 2);
  const above: number[] = [];
  layers.forEach((storey, number) => {
    const [low, high] = [number ? storey.low : -Infinity, storey.high];
    const cells = Array.from({ length: FLOOR_CELLS ** 2 }, (): number[] => []);
    for (let at = 0; at < points.byteLength; at += POINT_BYTES) {
      const z = (points.getUint16(at + 4, true) / 65535) * edge;
      if (z >= low && z <= high) cells[cellOf(points, at)]!.push(z);
    }
    const grid = smooth(filled(cells.map(lowest), cells));
    heights.set(grid, number * FLOOR_CELLS ** 2);
    cells.forEach((found, cell) => found.forEach((z) => above.push(z - grid[cell]!)));
  });
  above.sort((a, b) => a - b);
  return { heights, high: Math.max(MIN_HIGH_M, above[Math.floor(HIGH_SHARE * above.length)] ?? 0) };
}

function cellOf(points: DataView, at: number): number {
  const along = (offset: number) =>
    Math.min(FLOOR_CELLS - 1, Math.floor((points.getUint16(at + offset, true) / 65536) * FLOOR_CELLS));
  return along(2) * FLOOR_CELLS + along(0);
}

function lowest(heights: number[]): number {
  if (heights.length < MIN) return NaN;
  return heights.sort((a, b) => a - b)[Math.floor(LOW_SHARE * heights.length)]!;
}

/** Cells without a floor of their own take that of the nearest ones. */
function filled(grid: number[], cells: number[][]): number[] {
  const known = grid.filter((z) => !Number.isNaN(z));
  const all = cells.flat();
  if (!known.length) return grid.map(() => (all.length ? Math.min(...all) : 0));
  while (grid.some(Number.isNaN)) {
    grid = grid.map((z, cell) => {
      if (!Number.isNaN(z)) return z;
      const near = around(grid, cell).filter((other) => !Number.isNaN(other));
      return near.length ? near.reduce((sum, other) => sum + other, 0) / near.length : NaN;
    });
  }
  return grid;
}

/** The lower half of each neighbourhood decides: a cell that is all roof or rack is no floor. */
function smooth(grid: number[]): number[] {
  return grid.map((_, cell) => {
    const near = around(grid, cell).sort((a, b) => a - b);
    return near[Math.floor((near.length - 1) / 3)]!;
  });
}

/** A cell and its neighbours. */
function around(grid: number[], cell: number): number[] {
  const [x, y] = [cell % FLOOR_CELLS, Math.floor(cell / FLOOR_CELLS)];
  const found: number[] = [];
  for (let j = Math.max(0, y - 1); j <= Math.min(FLOOR_CELLS - 1, y + 1); j++)
    for (let i = Math.max(0, x - 1); i <= Math.min(FLOOR_CELLS - 1, x + 1); i++) found.push(grid[j * FLOOR_CELLS + i]!);
  return found;
}
