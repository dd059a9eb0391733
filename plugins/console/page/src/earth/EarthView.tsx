// Where a map lies on the Earth: then answers can be given as latitude, longitude and heading.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import { mapDetails, placeOf } from "../api/maps";
import { MapProblem } from "../maps/MapProblem";
import { useLoaded } from "../ui/useLoaded";
import { ConfirmPlace, type PlaceChange, removingOf, settingOf } from "./ConfirmPlace";
import { placeText } from "./place";
import { PlaceForm } from "./PlaceForm";

export function EarthView({ map }: { map: string }) {
  const found = useLoaded(async (signal) => {
    await mapDetails(map, signal); // a map that is not there is an error
    return { place: await placeOf(map, signal) };
  }, [map]);
  const asked = useSignal<PlaceChange | null>(null);
  if (found.error) return <MapProblem map={map} error={found.error} again={found.again} />;
  if (!found.value) return <p role="status">Reading where {map} lies …</p>;
  const { place } = found.value;
  return (
    <main class="page">
      <h1>{map} on the Earth</h1>
      <p role="status">
        {place
          ? placeText(place)
          : "It is not known where this map lies, so answers are poses in the map alone. With its place, the service gives latitude, longitude and heading too (Accept: application/geopose+json)."}
      </p>
      {mayBuild.value ? (
        <>
          <PlaceForm
            key={JSON.stringify(place)}
            place={place}
            give={(body) => (asked.value = settingOf(map, body, place !== null))}
          />
          {place ? <button onClick={() => (asked.value = removingOf(map))}>Remove the place</button> : null}
        </>
      ) : null}
      {asked.value ? <ConfirmPlace change={asked.value} done={found.again} close={() => (asked.value = null)} /> : null}
    </main>
  );
}
