// Keeps the scan laid over the map at a pose. While the pose is dragged, the points go with it in their old colours.

import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Group, Matrix4, Quaternion, Vector3 } from "three";
import type { Pose } from "../map3d/marks";
import { clear } from "../map3d/clear";
import type { MapScene } from "../map3d/scene";
import { drawOverlay, type OverlayShares } from "./overlay";
import type { Asked } from "./asked";

export interface OverlayState {
  group: Group;
  shares: Signal<OverlayShares | null>;
  moved: (pose: Pose) => void;
}

export function useOverlay(
  scene: RefObject<MapScene | null>,
  isReady: number,
  map: string,
  version: string,
  query: Asked | null,
  pose: Pose | null,
  problem: Signal<unknown>,
): OverlayState {
  const group = useRef(new Group()).current;
  const laid = useRef<Asked | null>(null);
  const laidAt = useRef<Matrix4 | null>(null);
  const shares = useSignal<OverlayShares | null>(null);
  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    shares.value = null; // those of another place
    if (laid.current !== query || !pose) {
      clear(group); // the points of another scan, or of a scan that has no place
      here.redraw();
    }
    laid.current = query;
    if (!query || !pose || !version) return;
    const stop = new AbortController();
    const drawn = new Group();
    drawOverlay(here, drawn, map, version, pose, query, stop.signal)
      .then((found) => {
        if (stop.signal.aborted) return;
        clear(group);
        place(group, new Matrix4());
        group.add(drawn);
        laidAt.current = matrixOf(here, pose);
        shares.value = found;
        here.redraw();
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      });
    return () => stop.abort();
  }, [query, isReady, version, pose && [...pose.position, ...pose.quaternion].join()]);
  const moved = (to: Pose) => {
    if (scene.current && laidAt.current) {
      place(group, matrixOf(scene.current, to).multiply(laidAt.current.clone().invert()));
    }
  };
  return { group, shares, moved };
}

function place(group: Group, matrix: Matrix4): void {
  matrix.decompose(group.position, group.quaternion, group.scale);
}

function matrixOf(scene: MapScene, pose: Pose): Matrix4 {
  const turn = new Quaternion().fromArray(pose.quaternion);
  return new Matrix4().compose(scene.local(pose.position), turn, new Vector3(1, 1, 1));
}
