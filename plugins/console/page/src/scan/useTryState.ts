// What the view that tries a scan is set to, from its address and into it. A link restores all of it.

import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { HandleMode } from "../map3d/poseHandle";
import { note, route } from "../router";
import { type HandPose } from "./handPose";
import { handOf, handText, type HandUse, usesOf } from "./tryState";
import type { HandState } from "./useHandle";

export interface TryState {
  least: Signal<string>; // "": the map's own
  hand: HandState;
  isPrior: Signal<boolean>;
  isTiltKnown: Signal<boolean>;
  isLaidByHand: Signal<boolean>;
}

export function useTryState(): TryState {
  const asked = route.value.query;
  const given = handOf(asked.get("hand"));
  const uses = usesOf(asked.get("hand_use"));
  const least = useSignal(asked.get("least") ?? "");
  const hand = {
    pose: useSignal<HandPose | null>(given),
    settled: useSignal<HandPose | null>(given),
    mode: useSignal<HandleMode>("translate"),
  };
  const used: Record<HandUse, Signal<boolean>> = {
    prior: useSignal(uses.includes("prior")),
    tilt: useSignal(uses.includes("tilt")),
    overlay: useSignal(uses.includes("overlay")),
  };
  useEffect(() => {
    least.value = asked.get("least") ?? "";
    for (const [use, isUsed] of Object.entries(used)) isUsed.value = uses.some((one) => one === use);
    if (handText(given) === handText(hand.settled.value)) return; // the pose has more digits than the address
    hand.pose.value = given;
    hand.settled.value = given;
  }, [route.value]);
  const noted = Object.entries(used).flatMap(([use, isUsed]) => (isUsed.value ? [use] : []));
  useEffect(() => {
    const hand_use = hand.settled.value ? noted.join(",") : "";
    note({ least: least.value, hand: handText(hand.settled.value), hand_use });
  }, [least.value, hand.settled.value, noted.join()]);
  return { least, hand, isPrior: used.prior, isTiltKnown: used.tilt, isLaidByHand: used.overlay };
}
