// The places of an answer in the picture: the chosen one with its axes, the others smaller the less likely they are, and
// the move that should tell them apart.

import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { ArrowHelper, Group, type Object3D, Quaternion, Vector3 } from "three";
import type { Schemas } from "../api/client";
import { dotsMark, onTop, type Pose, poseMark, ringMark } from "../map3d/marks";
import { clear } from "../map3d/clear";
import type { MapScene } from "../map3d/scene";
import { token } from "../ui/token";
import { colourOf } from "../ui/verdict";
import { type Ellipse, ellipseOf } from "./ellipse";
import { placesOf } from "./shares";

const MIN_SHOWN = 0.01; // less likely places are dots
const CHOSEN_SIZE = 2;

/** Draws them into the group that it returns. */
export function usePlaceMarks(
  scene: RefObject<MapScene | null>,
  isReady: number,
  answer: Schemas["Answer"] | null,
  chosen: number,
  areOthersShown: boolean,
): Group {
  const group = useRef(new Group()).current;
  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    clear(group);
    for (const place of answer ? placesOf(answer) : []) {
      const isChosen = place.number === chosen;
      if (!isChosen && !areOthersShown) continue;
      const pose = answer!.hypotheses[place.number]!.T_map_sensor;
      const at = here.local(pose.position);
      const tint = isChosen ? colourOf(answer!.verdict) : token("mark-other");
      // the covariance of an answer is that of its first hypothesis, and says nothing of another one
      if (place.number === 0 && answer!.covariance) group.add(ellipseMark(at, ellipseOf(answer!.covariance), tint));
      if (isChosen) group.add(poseMark(at, pose, tint, CHOSEN_SIZE));
      else if (place.probability < MIN_SHOWN) group.add(onTop(dotsMark(new Float32Array(at.toArray()), tint, 4)));
      else group.add(poseMark(at, pose, tint, 0.6 + 0.6 * place.probability));
    }
    const from = answer?.hypotheses[chosen]?.T_map_sensor;
    if (answer?.hint && from && answer.hint.distance_m > 0) group.add(...move(here, from, answer.hint.T_sensor_goal));
    here.redraw();
  }, [answer, chosen, areOthersShown, isReady]);
  return group;
}

/** The 95 % ellipse of a position, level. */
function ellipseMark(at: Vector3, { major_m, minor_m, angle_rad }: Ellipse, colour: number): Object3D {
  const ring = ringMark(1, colour);
  ring.scale.set(major_m, minor_m, 1);
  ring.rotation.z = angle_rad;
  ring.position.copy(at);
  return ring;
}

/** An arrow from a pose to a goal that is given in its frame, and the sensor there. */
function move(scene: MapScene, from: Pose, goal: Pose): Object3D[] {
  const turn = new Quaternion().fromArray(from.quaternion);
  const way = new Vector3().fromArray(goal.position).applyQuaternion(turn);
  const [start, length] = [scene.local(from.position), way.length()];
  const there = { position: goal.position, quaternion: turn.multiply(new Quaternion().fromArray(goal.quaternion)).toArray() };
  const tint = token("mark-hint");
  const arrow = new ArrowHelper(way.clone().normalize(), start, length, tint, 0.5, 0.35);
  return [onTop(arrow), poseMark(start.clone().add(way), there, tint)];
}
