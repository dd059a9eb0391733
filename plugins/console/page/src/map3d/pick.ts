// What is drawn at a place of the picture.

import { Box3, Matrix4, type PerspectiveCamera, type Points, Ray, Vector3 } from "three";

export interface Picture {
  camera: PerspectiveCamera;
  canvas: HTMLCanvasElement;
}

/** The point that is drawn nearest to a place of the window, within some pixels, in the scene. */
export function pointAt(
  { camera, canvas }: Picture,
  drawn: Points[],
  [low, high]: [number, number], // of z
  clientX: number,
  clientY: number,
  withinPx: number,
): Vector3 | null {
  const box = canvas.getBoundingClientRect();
  const [px, py] = [clientX - box.left, clientY - box.top];
  const project = new Matrix4();
  const whole = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
  const at = new Vector3();
  let best: Vector3 | null = null;
  let bestCost = Infinity;
  const mayHold = nearTheRay(camera, box, px, py, withinPx);
  for (const object of drawn) {
    if (!mayHold(object)) continue;
    project.multiplyMatrices(whole, object.matrixWorld);
    const packed = object.geometry.getAttribute("position");
    for (let i = 0; i < packed.count; i++) {
      at.set(packed.getX(i), packed.getY(i), packed.getZ(i)).applyMatrix4(project);
      if (at.z > 1 || at.z < -1) continue;
      const dx = ((at.x + 1) / 2) * box.width - px;
      const dy = ((1 - at.y) / 2) * box.height - py;
      const away = dx * dx + dy * dy;
      if (away > withinPx * withinPx) continue;
      const cost = at.z * 1e3 + away * 1e-3; // the nearest to the eye
      if (cost >= bestCost) continue;
      const position = new Vector3(packed.getX(i), packed.getY(i), packed.getZ(i)).applyMatrix4(object.matrixWorld);
      if (position.z < low || position.z > high) continue;
      bestCost = cost;
      best = position;
    }
  }
  return best;
}

/** Whether a node's cube is within some pixels of a place of the picture: the points of all others need no look. */
function nearTheRay(
  camera: PerspectiveCamera,
  box: DOMRect,
  px: number,
  py: number,
  withinPx: number,
): (object: Points) => boolean {
  const eye = camera.getWorldPosition(new Vector3());
  const there = new Vector3((2 * px) / box.width - 1, 1 - (2 * py) / box.height, 0.5).unproject(camera);
  const ray = new Ray(eye, there.sub(eye).normalize());
  const metresAside = (withinPx * 2 * Math.tan((camera.fov * Math.PI) / 360)) / box.height; // a metre away
  const cube = new Box3();
  return ({ position, scale }) => {
    cube.min.copy(position);
    cube.max.copy(position).addScalar(scale.x);
    const farthest = cube.distanceToPoint(eye) + 2 * scale.x;
    return ray.intersectsBox(cube.expandByScalar(metresAside * farthest));
  };
}

/** Which of some positions of the scene is drawn nearest to a place of the window, within some pixels; -1: none. */
export function nearestOf(
  { camera, canvas }: Picture,
  positions: Vector3[],
  clientX: number,
  clientY: number,
  withinPx: number,
): number {
  const box = canvas.getBoundingClientRect();
  let best = -1;
  let bestPx = withinPx;
  positions.forEach((position, i) => {
    const at = position.clone().project(camera);
    if (at.z > 1) return; // behind the eye
    const [x, y] = [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
    const away = Math.hypot(x - clientX, y - clientY);
    if (away <= bestPx) [best, bestPx] = [i, away];
  });
  return best;
}
