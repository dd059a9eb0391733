// Storeys of a map, from the heights at which its templates stand.

const APART_M = 1.8; // between the templates of two storeys
const FEWEST = 0.02; // of all templates: fewer are a stair or a ramp

export interface Storey {
  name: string;
  low: number; // metres, in the frame of the given heights
  high: number;
}

/** Storeys from below; one alone where the ground goes up and down without a gap. */
export function storeysOf(heights: Float32Array | number[], sensorHeight = 1.5): Storey[] {
  const sorted = Array.from(heights).sort((a, b) => a - b);
  if (!sorted.length) return [];
  const groups: number[][] = [[sorted[0]!]];
  for (let i = 1; i < sorted.length; i++) {
    if (sorted[i]! - sorted[i - 1]! > APART_M) groups.push([]);
    groups.at(-1)!.push(sorted[i]!);
  }
  const large = groups.filter((group) => group.length >= FEWEST * sorted.length);
  const floors = large.map((group) => group[0]! - sensorHeight);
  return floors.map((low, i) => ({
    name: `Storey ${i + 1}`,
    low: low - 0.4,
    high: i + 1 < floors.length ? floors[i + 1]! - 0.4 : Infinity,
  }));
}
