// Where a map lies on the Earth: then answers can be given as latitude, longitude and heading.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { mapDetails, placeOf, removePlace, setPlace } from "../api/maps";
import { MapProblem } from "../maps/MapProblem";
import { Confirm } from "../ui/Confirm";
import { useLoaded } from "../ui/useLoaded";
import { PlaceForm } from "./PlaceForm";
import { placeText } from "./place";

export function EarthView({ map }: { map: string }) {
  const found = useLoaded(async (signal) => {
    await mapDetails(map, signal); // a map that is not there is an error
    return { place: await placeOf(map, signal) };
  }, [map]);
  const wanted = useSignal<Schemas["GeoreferenceBody"] | null>(null);
  const isRemoving = useSignal(false);
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
          <PlaceForm key={JSON.stringify(place)} place={place} give={(body) => (wanted.value = body)} />
          {place ? <button onClick={() => (isRemoving.value = true)}>Remove the place</button> : null}
        </>
      ) : null}
      {wanted.value ? (
        <Confirm
          title={`Set where ${map} lies`}
          action="Set it"
          keep="Leave it"
          act={async () => {
            await setPlace(map, wanted.value!);
            found.again();
          }}
          close={() => (wanted.value = null)}
        >
          <p>
            {place
              ? "From now on all geographic poses in this map are other ones, for every version. The numbers above bring the present place back."
              : "From now on answers in this map can be given as geographic poses, for every version."}
          </p>
        </Confirm>
      ) : null}
      {isRemoving.value ? (
        <Confirm
          title={`Remove where ${map} lies`}
          action="Remove"
          keep="Keep it"
          act={async () => {
            await removePlace(map);
            found.again();
          }}
          close={() => (isRemoving.value = false)}
        >
          <p>Who asks for geographic poses in this map gets an error (406) from now on. Poses in the map stay as they are.</p>
        </Confirm>
      ) : null}
    </main>
  );
}
