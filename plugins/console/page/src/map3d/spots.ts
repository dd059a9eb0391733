// The grid of a version's self-test: how scans did in each cell, and which place each was taken for.
// Its cells are counted in the version's levelled frame, so two versions need not have the same.

import type { Schemas } from "../api/client";
import { versionDetails, versionReport } from "../api/maps";

/** One cell of the self-test's grid. */
export interface SpotCell {
  cell: [number, number];
  scans: number;
  localized: number;
  wrong: number;
  taken_for: [number, number] | null;
  never_seen?: number; // share of the space around; none: not known
  in_part?: boolean; // mapped from a door or from afar
  found?: number; // scans whose right place is the best or ties; none: by an earlier release
  helps?: string; // a code of HELPS: the place is known and not said, as half are found and fewer localized
}

const HELPS: Record<string, string> = {
  second_scan: "a second scan from 1 to 2 m further on, or a prior",
  prior: "a prior, as what looks alike is above, below or beside it",
  other_height: "a scan from another height, or a second one from 1 to 2 m further on",
  drive_through: "driving through it while mapping, as it was mapped in part",
};

/** What helps where a place is known and not said; empty where it is said, or not known. */
export function helpAt({ helps }: SpotCell): string {
  return helps === undefined ? "" : HELPS[helps] ?? helps;
}

type Triple = [number, number, number];
export const SPOT_CELL_M = 4;

export class SpotGrid {
  private readonly found: Map<string, SpotCell>;
  private readonly heights = new Map<string, number>(); // of the lowest template of each cell
  private readonly height: number;

  /** `T_map_level`: 16 numbers, row by row. `templates`: (x, y, z) of the map one after the other. */
  constructor(
    readonly cells: SpotCell[],
    private readonly T_map_level: number[],
    templates: ArrayLike<number>,
  ) {
    this.found = new Map(cells.map((one) => [one.cell.join(), one]));
    for (let i = 0; i + 2 < templates.length; i += 3) {
      const [x, y, z] = this.inLevel([templates[i]!, templates[i + 1]!, templates[i + 2]!]);
      const key = keyOf(x, y);
      this.heights.set(key, Math.min(z, this.heights.get(key) ?? Infinity));
    }
    const sorted = [...this.heights.values()].sort((a, b) => a - b);
    this.height = sorted[sorted.length >> 1] ?? 0;
  }

  /** The tested cell at a position of the map; undefined where no scan of the test was taken. */
  at(position: Triple): SpotCell | undefined {
    const [x, y] = this.inLevel(position);
    return this.found.get(keyOf(x, y));
  }

  /** Middle of a cell in the map's frame, as high as the sensor stood there; or so many cells beside it. */
  middle([i, j]: [number, number], x = 0, y = 0): Triple {
    const z = this.heights.get(`${i},${j}`) ?? this.height;
    const level = [(i + 0.5 + x) * SPOT_CELL_M, (j + 0.5 + y) * SPOT_CELL_M, z];
    const T = this.T_map_level;
    return [0, 1, 2].map(
      (row) => T[4 * row]! * level[0]! + T[4 * row + 1]! * level[1]! + T[4 * row + 2]! * level[2]! + T[4 * row + 3]!,
    ) as Triple;
  }

  /** Cells whose scans were not localized and resembled another cell. */
  get confused(): SpotCell[] {
    return this.cells.filter(({ cell, taken_for }) => taken_for !== null && taken_for.join() !== cell.join());
  }

  /** Cells that were taken for this one. */
  takenFor(cell: [number, number]): SpotCell[] {
    return this.confused.filter((one) => one.taken_for!.join() === cell.join());
  }

  private inLevel(position: Triple): Triple {
    const T = this.T_map_level;
    const from = position.map((m, row) => m - T[4 * row + 3]!);
    return [0, 1, 2].map((axis) => T[axis]! * from[0]! + T[4 + axis]! * from[1]! + T[8 + axis]! * from[2]!) as Triple;
  }
}

function keyOf(x: number, y: number): string {
  return `${Math.floor(x / SPOT_CELL_M)},${Math.floor(y / SPOT_CELL_M)}`;
}

export function localizedShare({ localized, scans }: SpotCell): number {
  return scans ? localized / scans : 0;
}

/** The self-test is open in the API, as its manifest is. */
export function cellsOf({ self_test }: Schemas["VersionReport"]): SpotCell[] {
  return (self_test.localizability ?? []) as SpotCell[];
}

export async function spotGrid(
  map: string,
  version: string,
  templates: ArrayLike<number>,
  signal?: AbortSignal,
): Promise<SpotGrid> {
  const [details, report] = await Promise.all([
    versionDetails(map, version, signal),
    versionReport(map, version, signal),
  ]);
  const engine = details.manifest.engine as { T_map_level: number[] };
  return new SpotGrid(cellsOf(report), engine.T_map_level, templates);
}
