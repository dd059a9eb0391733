// From where to look at a box so that all of it is in the picture, and as large as it can be.

type Triple = [number, number, number];

export interface View {
  target: Triple;
  eye: Triple;
}

const DOWN = (52 * Math.PI) / 180; // below the horizon
const MARGIN = 1.06;

/** Looks north and down. `fov_deg` is the angle of view from top to bottom. */
export function framed(low: Triple, high: Triple, fov_deg: number, aspect: number): View {
  const middle = low.map((m, axis) => (m + high[axis]!) / 2) as Triple;
  const half = low.map((m, axis) => (high[axis]! - m) / 2) as Triple;
  const [sine, cosine] = [Math.sin(DOWN), Math.cos(DOWN)];
  const tall = Math.tan((fov_deg * Math.PI) / 360) / MARGIN;
  const wide = tall * aspect;
  const corners: Triple[] = [];
  for (const x of [-half[0], half[0]])
    for (const y of [-half[1], half[1]])
      for (const z of [-half[2], half[2]]) {
        // along the camera's axes: to the right, up, and away from the eye
        corners.push([x, y * sine + z * cosine, y * cosine - z * sine]);
      }
  let distance = 0;
  let up = 0; // of the target over the middle, so that the near and far side are as far from the picture's edges
  for (let turn = 0; turn < 20; turn++) {
    const needed = corners.map(([x, y, away]) => Math.max(Math.abs(x) / wide, Math.abs(y - up) / tall) - away);
    distance = Math.max(...needed, 0.1);
    const tangents = corners.map(([, y, away]) => (y - up) / (distance + away));
    up += 0.5 * distance * (Math.min(...tangents) + Math.max(...tangents));
  }
  const target: Triple = [middle[0], middle[1] + up * sine, middle[2] + up * cosine];
  return { target, eye: [target[0], target[1] - distance * cosine, target[2] + distance * sine] };
}

/** Looks straight down at all of a box, north (y) up. */
export function fromAbove(low: Triple, high: Triple, fov_deg: number, aspect: number): View {
  const target = low.map((m, axis) => (m + high[axis]!) / 2) as Triple;
  const half = low.map((m, axis) => (high[axis]! - m) / 2) as Triple;
  const tall = Math.tan((fov_deg * Math.PI) / 360) / MARGIN;
  const distance = Math.max(half[0] / (tall * aspect), half[1] / tall, 0.1) + half[2];
  return { target, eye: [target[0], target[1], target[2] + distance] };
}
