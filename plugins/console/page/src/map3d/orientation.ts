// How large a metre is in the picture, and where the axes of the map point: what the scale bar and the axes show.

import { type PerspectiveCamera, Vector3 } from "three";

export interface Orientation {
  metresPerPixel: number; // at what the camera looks at
  axes: [number, number][]; // of x, y and z: to the right and up, of length 1 where it lies in the picture
}

export function orientationOf(camera: PerspectiveCamera, target: Vector3, heightPx: number): Orientation {
  const away = camera.position.distanceTo(target);
  const across = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0).toArray();
  const up = new Vector3().setFromMatrixColumn(camera.matrixWorld, 1).toArray();
  return {
    metresPerPixel: (2 * away * Math.tan((camera.fov * Math.PI) / 360)) / Math.max(heightPx, 1),
    axes: across.map((right, axis) => [right, up[axis]!]),
  };
}

/** The longest of 1, 2, 5, 10, ... metres (or parts of one) that is at most so many pixels long. */
export function barOf(metresPerPixel: number, mostPx: number): { m: number; px: number } {
  const most = metresPerPixel * mostPx;
  const power = 10 ** Math.floor(Math.log10(most));
  const m = power * ([5, 2].find((one) => one * power <= most) ?? 1);
  return { m, px: m / metresPerPixel };
}
