// The form for a map's place: latitude, longitude, height, and where its x axis points.

import { useSignal } from "@preact/signals";
import type { Schemas } from "../api/client";
import { isTilted } from "./place";

interface Field {
  name: "latitude_deg" | "longitude_deg" | "height_m" | "x_axis_deg";
  label: string;
  most: number;
}

const FIELDS: Field[] = [
  { name: "latitude_deg", label: "Latitude of the map's origin, degrees (WGS84)", most: 90 },
  { name: "longitude_deg", label: "Longitude, degrees", most: 180 },
  { name: "height_m", label: "Height above the ellipsoid, metres: not above sea level", most: 1e5 },
  { name: "x_axis_deg", label: "The map's x axis, degrees counter-clockwise from east: 0 is east, 90 is north", most: 360 },
];

export interface PlaceFormProps {
  place: Schemas["GeoreferenceRecord"] | null;
  give: (body: Schemas["GeoreferenceBody"]) => void;
}

export function PlaceForm({ place, give }: PlaceFormProps) {
  const texts = useSignal(Object.fromEntries(FIELDS.map(({ name }) => [name, place ? String(place[name]) : ""])));
  const submit = (event: Event) => {
    event.preventDefault();
    const number = (name: Field["name"]) => Number(texts.value[name]);
    give({
      latitude_deg: number("latitude_deg"),
      longitude_deg: number("longitude_deg"),
      height_m: number("height_m"),
      x_axis_deg: number("x_axis_deg"),
      quaternion: null,
      anchor_m: place?.anchor_m ?? [0, 0, 0],
    });
  };
  return (
    <form class="place" onSubmit={submit}>
      {FIELDS.map(({ name, label, most }) => (
        <label key={name}>
          {label}
          <input
            required
            type="number"
            step="any"
            min={-most}
            max={most}
            value={texts.value[name]}
            onInput={(event) => (texts.value = { ...texts.value, [name]: event.currentTarget.value })}
          />
        </label>
      ))}
      {place && isTilted(place) ? (
        <p class="hint">The map is tilted there. A change here makes its z axis point up; the API can set a tilt.</p>
      ) : null}
      <div class="row">
        <button class="primary">{place ? "Change the place" : "Set the place"}</button>
      </div>
    </form>
  );
}
