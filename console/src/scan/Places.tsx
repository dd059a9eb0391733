// Every place that the answer considered, the likeliest first.

import { useSignal } from "@preact/signals";
import type { Schemas } from "../api/client";
import { chance, metres, percent } from "../ui/text";
import { ellipseOf } from "./ellipse";
import { headingOf } from "./handPose";
import { type Place, placesOf } from "./shares";

const LISTED = 8;
const DEGREES = 180 / Math.PI;

export interface PlacesProps {
  answer: Schemas["Answer"];
  chosen: number;
  choose: (hypothesis: number) => void;
}

export function Places({ answer, chosen, choose }: PlacesProps) {
  const isWhole = useSignal(false);
  const places = placesOf(answer);
  const listed = isWhole.value ? places : places.slice(0, LISTED);
  return (
    <>
      <h3>Places</h3>
      <ol class="hypotheses">
        {listed.map((place) => (
          <li key={place.number}>
            <button aria-pressed={place.number === chosen} onClick={() => choose(place.number)}>
              <PlaceText place={place} answer={answer} />
            </button>
          </li>
        ))}
      </ol>
      {places.length > listed.length ? (
        <button onClick={() => (isWhole.value = true)}>All {places.length} places</button>
      ) : null}
    </>
  );
}

function PlaceText({ place, answer }: { place: Place; answer: Schemas["Answer"] }) {
  const one = answer.hypotheses[place.number]!;
  return (
    <>
      <strong>{chance(place.probability)}</strong> at {one.T_map_sensor.position.map(metres).join(", ")}, heading{" "}
      {headingOf(one.T_map_sensor.quaternion).toFixed(1)}°
      <small>
        {percent(one.inlier_ratio)} on the map, {percent(one.free_space_violation, 1)} through it
        {place.number === 0 && answer.covariance ? `, ${sigmasOf(answer.covariance)}` : ""}
      </small>
    </>
  );
}

/** How sure the pose is: one standard deviation, and the half axes of the ellipse in the picture. */
function sigmasOf(covariance: number[]): string {
  const [x, y, z, , , yaw] = [0, 1, 2, 3, 4, 5].map((i) => Math.sqrt(Math.max(0, covariance[7 * i]!)));
  const { major_m, minor_m } = ellipseOf(covariance);
  const ellipse = `95 % ellipse ${major_m.toFixed(3)} by ${minor_m.toFixed(3)} m`;
  return `± ${Math.hypot(x!, y!).toFixed(3)} m, height ± ${z!.toFixed(3)} m, heading ± ${(yaw! * DEGREES).toFixed(2)}°, ${ellipse}`;
}
