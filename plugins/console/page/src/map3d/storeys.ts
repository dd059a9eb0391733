// Storeys of a map, from the heights at which its templates stand, each without its ceiling.

const APART_M = 1.8; // between the templates of two storeys
const MIN = 0.02; // of all templates: fewer are a stair or a ramp
const BELOW_TEMPLATES_M = 2.5; // the floor, wherever the sensor is mounted
const CLEAR_M = 0.6; // above the templates a ceiling may begin
const CEILING_SHARE = 0.04; // of the points of a storey that look down: fewer are the undersides of things
const UNDER_CEILING_M = 0.3;
const POINT_BYTES = 8;

export interface Storey {
  name: string;
  low: number; // metres from the cloud's low corner
  high: number; // just under its ceiling; without one the next storey's floor
}

/** Heights of templates, (x, y, z) one after the other. */
export function heightsOf(positions: Float32Array): Float32Array {
  return Float32Array.from({ length: positions.length / 3 }, (_, i) => positions[3 * i + 2]!);
}

/**
 * Storeys from below; one alone where the ground goes up and down without a gap.
 *
 * `root` holds the points of the cloud's root, whose edge is given.
 */
export function storeysOf(heights: ArrayLike<number>, root: ArrayBuffer, edge: number): Storey[] {
  const sorted = Float64Array.from(heights).sort();
  if (!sorted.length) return [];
  const groups: Float64Array[] = [];
  let first = 0;
  for (let i = 1; i <= sorted.length; i++) {
    if (i < sorted.length && sorted[i]! - sorted[i - 1]! <= APART_M) continue;
    groups.push(sorted.subarray(first, i));
    first = i;
  }
  const large = groups.filter((group) => group.length >= MIN * sorted.length);
  const points = new DataView(root);
  return large.map((group, i) => {
    const low = i ? (large[i - 1]!.at(-1)! + group[0]!) / 2 : group[0]! - BELOW_TEMPLATES_M;
    const above = large[i + 1]?.[0];
    const top = above === undefined ? edge : (group.at(-1)! + above) / 2 + APART_M;
    return { name: `Storey ${i + 1}`, low, high: underCeiling(points, edge, group.at(-1)! + CLEAR_M, low, top) };
  });
}

/** Height just under the ceiling; `top` where there is none. */
function underCeiling(points: DataView, edge: number, from: number, low: number, top: number): number {
  const down: number[] = [];
  let all = 0;
  for (let at = 0; at < points.byteLength; at += POINT_BYTES) {
    const z = (points.getUint16(at + 4, true) / 65535) * edge;
    if (z < low || z > top) continue;
    all += 1;
    const [ex, ey] = [points.getInt8(at + 6), points.getInt8(at + 7)];
    if (ex === -128) continue;
    // the octahedral map: beyond this sum of the two, the normal looks down by more than 53 degrees
    if (z > from && Math.abs(ex) + Math.abs(ey) > 127 * 1.6) down.push(z);
  }
  if (down.length < CEILING_SHARE * all) return top;
  down.sort((a, b) => a - b);
  return down[Math.floor(down.length / 10)]! - UNDER_CEILING_M;
}
