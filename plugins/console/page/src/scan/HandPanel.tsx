// A pose by hand, in numbers: where the robot is thought to be, or where it really was.

import type { Signal } from "@preact/signals";
import { Check } from "../ui/Check";
import { NumberField } from "../ui/NumberField";
import type { HandPose } from "./handPose";
import type { HandState } from "./useHandle";

export interface HandPanelProps {
  hand: HandState;
  isPrior: Signal<boolean>;
  isTiltKnown: Signal<boolean>;
  /** Begins with the place that is shown, or the middle of the picture. */
  begin: () => void;
}

const MIN_RADIUS_M = 0.1;
const MIN_YAW_DEG = 1;

type Angle = "roll_deg" | "pitch_deg" | "yaw_deg";
const ANGLES: [Angle, string][] = [
  ["roll_deg", "Roll (°)"],
  ["pitch_deg", "Pitch (°)"],
  ["yaw_deg", "Yaw (°)"],
];

export function HandPanel({ hand, isPrior, isTiltKnown, begin }: HandPanelProps) {
  const pose = hand.pose.value;
  if (!pose) {
    return (
      <section>
        <h3>A pose by hand</h3>
        <p class="hint">Click the map where the robot is, or begin here and drag. It changes the answer only if you say so.</p>
        <button onClick={begin}>Place by hand</button>
      </section>
    );
  }
  const set = (changed: Partial<HandPose>) => {
    hand.pose.value = { ...pose, ...changed };
    hand.settled.value = hand.pose.value;
  };
  const remove = () => {
    hand.pose.value = null;
    hand.settled.value = null;
  };
  const moved = (axis: number, m: number) => {
    const position: HandPose["position"] = [...pose.position];
    position[axis] = m;
    set({ position });
  };
  return (
    <section aria-label="A pose by hand">
      <h3>A pose by hand</h3>
      <div class="row" role="group" aria-label="What dragging does">
        <button aria-pressed={hand.mode.value === "translate"} onClick={() => (hand.mode.value = "translate")}>
          Move
        </button>
        <button aria-pressed={hand.mode.value === "rotate"} onClick={() => (hand.mode.value = "rotate")}>
          Turn
        </button>
        <button onClick={remove}>Remove</button>
      </div>
      <div class="numbers">
        {["x (m)", "y (m)", "z (m)"].map((name, axis) => (
          <NumberField key={name} name={name} value={shown(pose.position[axis]!)} step={0.1} set={(m) => moved(axis, m)} />
        ))}
        {ANGLES.map(([field, name]) => (
          <NumberField key={name} name={name} value={shown(pose[field])} step={1} set={(degrees) => set({ [field]: degrees })} />
        ))}
      </div>
      <Check value={isPrior}>Search only around it</Check>
      {isPrior.value ? (
        <>
          <div class="numbers">
            <NumberField
              name="Within (m)"
              value={shown(pose.radius_m)}
              step={0.5}
              least={MIN_RADIUS_M}
              set={(m) => set({ radius_m: Math.max(MIN_RADIUS_M, m) })}
            />
            <NumberField
              name="Heading ± (°)"
              value={shown(pose.yaw_range_deg)}
              step={5}
              least={MIN_YAW_DEG}
              most={180}
              set={(degrees) => set({ yaw_range_deg: Math.min(180, Math.max(MIN_YAW_DEG, degrees)) })}
            />
          </div>
          <Check value={isTiltKnown}>Its roll and pitch are known, too</Check>
        </>
      ) : null}
    </section>
  );
}

/** A number as it is shown: what was dragged has many digits. */
function shown(value: number): number {
  return Number(value.toFixed(2));
}
