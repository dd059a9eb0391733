// The handle in the picture that shows a hand-given pose, and changes it.

import type { Signal } from "@preact/signals";
import { type RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { type HandleMode, PoseHandle } from "../map3d/poseHandle";
import type { Pose } from "../map3d/marks";
import type { MapScene } from "../map3d/scene";
import { type HandPose, handPoseOf, poseOf } from "./handPose";

export interface HandState {
  pose: Signal<HandPose | null>; // as it is on the way
  settled: Signal<HandPose | null>; // when it is let go: what queries use
  mode: Signal<HandleMode>;
}

/** `dragged` is told every pose on the way. */
export function useHandle(
  scene: RefObject<MapScene | null>,
  isReady: number,
  hand: HandState,
  dragged: (pose: Pose) => void,
): void {
  const handle = useRef<PoseHandle | null>(null);
  const isShown = hand.pose.value !== null;
  useEffect(() => {
    if (!scene.current || !isShown) return;
    handle.current = new PoseHandle(scene.current, (pose, isDone) => {
      hand.pose.value = handPoseOf(pose, hand.pose.value);
      dragged(pose);
      if (isDone) hand.settled.value = hand.pose.value;
    });
    return () => {
      handle.current?.dispose();
      handle.current = null;
    };
  }, [isReady, isShown]);
  useEffect(() => {
    const pose = hand.pose.value;
    if (pose) handle.current?.place(poseOf(pose), pose.radius_m);
  }, [isReady, hand.pose.value]);
  useEffect(() => {
    if (handle.current) handle.current.mode = hand.mode.value;
  }, [isReady, isShown, hand.mode.value]);
}
