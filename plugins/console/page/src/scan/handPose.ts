// A pose that a person gives by hand, how sure they are of it, and the options of a query that say so.

export interface HandPose {
  position: [number, number, number];
  roll_deg: number; // about x, then pitch about y, then yaw about z
  pitch_deg: number;
  yaw_deg: number;
  radius_m: number; // the sensor is not further from the position
  yaw_range_deg: number; // to either side; 180: any heading
}

export interface PlainPose {
  position: number[];
  quaternion: number[]; // x, y, z, w
}

const DEGREES = 180 / Math.PI;
const NEAR = { radius_m: 5, yaw_range_deg: 180 };

/** A level pose at a position. */
export function handPoseAt(position: [number, number, number], before: HandPose | null): HandPose {
  return before ? { ...before, position } : { position, roll_deg: 0, pitch_deg: 0, yaw_deg: 0, ...NEAR };
}

/** The same place by hand, as sure as before. */
export function handPoseOf(pose: PlainPose, before: HandPose | null): HandPose {
  const [x, y, z, w] = pose.quaternion as [number, number, number, number];
  const sine = 2 * (w * y - z * x);
  return {
    ...NEAR,
    ...before,
    position: [...pose.position] as [number, number, number],
    roll_deg: Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * DEGREES,
    pitch_deg: Math.asin(Math.min(1, Math.max(-1, sine))) * DEGREES,
    yaw_deg: headingOf(pose.quaternion),
  };
}

/** Angle about the vertical, from the map's x axis to the left. */
export function headingOf(quaternion: number[]): number {
  const [x, y, z, w] = quaternion as [number, number, number, number];
  return Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * DEGREES;
}

export function poseOf(hand: HandPose): PlainPose {
  const half = [hand.roll_deg, hand.pitch_deg, hand.yaw_deg].map((degrees) => degrees / DEGREES / 2);
  const [cr, cp, cy] = half.map(Math.cos) as [number, number, number];
  const [sr, sp, sy] = half.map(Math.sin) as [number, number, number];
  return {
    position: hand.position,
    quaternion: [
      sr * cp * cy - cr * sp * sy,
      cr * sp * cy + sr * cp * sy,
      cr * cp * sy - sr * sp * cy,
      cr * cp * cy + sr * sp * sy,
    ],
  };
}

/** The option `prior`. */
export function priorOf(hand: HandPose): string {
  const sphere = [...hand.position.map((m) => m.toFixed(3)), plain(hand.radius_m)];
  const isAny = hand.yaw_range_deg >= 180;
  return (isAny ? sphere : [...sphere, plain(hand.yaw_deg), plain(hand.yaw_range_deg)]).join(",");
}

/** The option `gravity`: the prior has no roll and pitch, because gravity says them. */
export function gravityOf(hand: HandPose): string {
  return `${plain(hand.roll_deg)},${plain(hand.pitch_deg)}`;
}

function plain(number: number): string {
  return String(Number(number.toFixed(3)));
}
