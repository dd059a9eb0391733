// From where to look at a box so that all of it is in the picture, and as large as it can be.

type Triple = [number, number, number];

const DOWN = (52 * Math.PI) / 180; // below the horizon
const MARGIN = 1.06;

/** Looks north and down. `fov_deg` is the angle of view from top to bottom. */
export function framed(low: Triple, high: Triple, fov_deg: number, aspect: number): { target: Triple; eye: Triple } {
  const middle = low.map((m, axis) => (m + high[axis]!) / 2) as Triple;
  const half = low.map((m, axis) => (high[axis]! - m) / 2) as Triple;
  const [sine, cosine] = [Math.sin(DOWN), Math.cos(DOWN)];
  const tall = Math.tan((fov_deg * Math.PI) / 360) / MARGIN;
  const wide = tall * aspect;
  // In the camera's axes a corner lies at (x, y sin + z cos) and (y cos - z sin) deeper than the middle. Shifting the
  // target up the picture by `up` puts the box between the edges; the tangents at its near and far edge give both.
  let distance = 0.1;
  let up = 0;
  for (let turn = 0; turn < 20; turn++) {
    let [least, most, need] = [Infinity, -Infinity, 0];
    for (const x of [-half[0], half[0]])
      for (const y of [-half[1], half[1]])
        for (const z of [-half[2], half[2]]) {
          const across = y * sine + z * cosine - up;
          const deeper = y * cosine - z * sine;
          need = Math.max(need, Math.abs(x) / wide - deeper, Math.abs(across) / tall - deeper);
          const tangent = across / Math.max(distance + deeper, 0.1);
          least = Math.min(least, tangent);
          most = Math.max(most, tangent);
        }
    distance = Math.max(need, 0.1);
    up += ((least + most) / 2) * distance * 0.7;
  }
  const target: Triple = [middle[0], middle[1] + up * sine, middle[2] + up * cosine];
  return { target, eye: [target[0], target[1] - distance * cosine, target[2] + distance * sine] };
}
