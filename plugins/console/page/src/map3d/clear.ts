import type { Object3D, Points } from "three";

/** Removes and frees all that a group holds. */
export function clear(group: Object3D): void {
  group.traverse((one) => {
    const held = one as Partial<Points>;
    held.geometry?.dispose();
  });
  group.clear();
}
