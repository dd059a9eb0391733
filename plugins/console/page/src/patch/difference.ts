// Which points of one cloud the other one has not.

const PLACES = 2 ** 17; // along an axis: three of them make a whole number that a double holds

/** The points (x, y, z one after the other, none negative) of `of` that have none of `other` within `within_m`, or little more. */
export function onlyIn(of: Float32Array, other: Float32Array, within_m: number): Float32Array {
  const edge = Math.max(2 * within_m, highest(of, other) / (PLACES - 4));
  const taken = new Set<number>();
  const place = (m: number) => Math.floor(m / edge) + 1;
  for (let i = 0; i < other.length; i += 3) taken.add(key(place(other[i]!), place(other[i + 1]!), place(other[i + 2]!)));
  const found: number[] = [];
  for (let i = 0; i < of.length; i += 3) {
    const [x, y, z] = [of[i]!, of[i + 1]!, of[i + 2]!];
    const low = [x, y, z].map((m) => place(m - edge / 2)) as [number, number, number]; // of the 8 cells around it
    if (!isTaken(taken, low)) found.push(x, y, z);
  }
  return new Float32Array(found);
}

function isTaken(taken: ReadonlySet<number>, [x, y, z]: [number, number, number]): boolean {
  for (let corner = 0; corner < 8; corner++) {
    if (taken.has(key(x + (corner & 1), y + ((corner >> 1) & 1), z + (corner >> 2)))) return true;
  }
  return false;
}

function key(x: number, y: number, z: number): number {
  return (x * PLACES + y) * PLACES + z;
}

function highest(...parts: Float32Array[]): number {
  let found = 0;
  for (const part of parts) for (const m of part) found = Math.max(found, m);
  return found;
}
