// Every place that the answer considered, side by side, the likeliest first.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import type { Schemas } from "../api/client";
import { chance, percent } from "../ui/text";
import { deviationsOf, ellipseOf } from "./ellipse";
import { headingOf } from "./handPose";
import { type Place, placesOf } from "./shares";

const LISTED = 8;
const NUMBERS = ["Probability", "x (m)", "y (m)", "z (m)", "Heading (°)", "On the map", "Through it"] as const;

export interface PlacesProps {
  answer: Schemas["Answer"];
  chosen: number;
  choose: (hypothesis: number) => void;
}

export function Places({ answer, chosen, choose }: PlacesProps) {
  const isWhole = useSignal(false);
  const places = placesOf(answer);
  // a place that a link chose is listed, however unlikely it is
  const fewest = Math.max(LISTED, 1 + places.findIndex((one) => one.number === chosen));
  const listed = isWhole.value ? places : places.slice(0, fewest);
  const rank = 1 + places.findIndex((one) => one.number === 0);
  return (
    <>
      <h3>Places</h3>
      <div class="places">
        <table>
          <thead>
            <tr>
              <th>Place</th>
              {NUMBERS.map((name) => (
                <th key={name} class="number">
                  {name}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {listed.map((place, i) => (
              <PlaceRow
                key={place.number}
                rank={i + 1}
                place={place}
                answer={answer}
                isChosen={place.number === chosen}
                choose={() => choose(place.number)}
              />
            ))}
          </tbody>
        </table>
      </div>
      {answer.covariance ? <Ellipse covariance={answer.covariance} rank={rank} /> : null}
      {places.length > listed.length ? (
        <button onClick={() => (isWhole.value = true)}>All {places.length} places</button>
      ) : null}
    </>
  );
}

interface PlaceRowProps {
  rank: number; // from 1
  place: Place;
  answer: Schemas["Answer"];
  isChosen: boolean;
  choose: () => void;
}

/** The arrow keys go from row to row, as in each group of radio buttons; a click anywhere in a row chooses it. */
function PlaceRow({ rank, place, answer, isChosen, choose }: PlaceRowProps) {
  const one = answer.hypotheses[place.number]!;
  const [x, y, z] = one.T_map_sensor.position as [number, number, number];
  // the covariance of an answer is that of its first hypothesis
  const sigma = place.number === 0 && answer.covariance ? deviationsOf(answer.covariance) : null;
  return (
    <tr onClick={choose}>
      <th scope="row">
        <label class="check">
          <input type="radio" name="place" aria-label={`Place ${rank}`} checked={isChosen} onChange={choose} />
          {rank}
        </label>
      </th>
      <Figure name="Probability">{chance(place.probability)}</Figure>
      <Figure name="x (m)" deviation={sigma?.x_m.toFixed(3)}>{x.toFixed(2)}</Figure>
      <Figure name="y (m)" deviation={sigma?.y_m.toFixed(3)}>{y.toFixed(2)}</Figure>
      <Figure name="z (m)" deviation={sigma?.z_m.toFixed(3)}>{z.toFixed(2)}</Figure>
      <Figure name="Heading (°)" deviation={sigma?.heading_deg.toFixed(2)}>
        {headingOf(one.T_map_sensor.quaternion).toFixed(1)}
      </Figure>
      <Figure name="On the map">{percent(one.inlier_ratio)}</Figure>
      <Figure name="Through it">{percent(one.free_space_violation, 1)}</Figure>
    </tr>
  );
}

interface FigureProps {
  name: (typeof NUMBERS)[number];
  deviation?: string | undefined;
  children: ComponentChildren;
}

/** A number with its standard deviation below it, where that is known. */
function Figure({ name, deviation, children }: FigureProps) {
  return (
    <td class="number" data-name={name}>
      {children}
      {deviation === undefined ? null : <small>± {deviation}</small>}
    </td>
  );
}

function Ellipse({ covariance, rank }: { covariance: number[]; rank: number }) {
  const { major_m, minor_m } = ellipseOf(covariance);
  return (
    <p class="hint">
      ±: one standard deviation. The ring is the 95 % ellipse of place {rank}, {major_m.toFixed(3)} by {minor_m.toFixed(3)} m.
    </p>
  );
}
