// The question before a map's place on the Earth is changed: what happens to geographic poses.

import type { Schemas } from "../api/client";
import { removePlace, setPlace } from "../api/maps";
import { Confirm, type Question } from "../ui/Confirm";

export interface PlaceChange extends Question {
  text: string; // what happens
}

export function settingOf(map: string, body: Schemas["GeoreferenceBody"], hasPlace: boolean): PlaceChange {
  return {
    title: `Set where ${map} lies`,
    action: "Set it",
    keep: "Leave it",
    text: hasPlace
      ? "From now on all geographic poses in this map are other ones, for every version. The numbers above bring the present place back."
      : "From now on answers in this map can be given as geographic poses, for every version.",
    act: () => setPlace(map, body),
  };
}

export function removingOf(map: string): PlaceChange {
  return {
    title: `Remove where ${map} lies`,
    action: "Remove",
    keep: "Keep it",
    text: "Who asks for geographic poses in this map gets an error (406) from now on. Poses in the map stay as they are.",
    act: () => removePlace(map),
  };
}

export function ConfirmPlace({ change, done, close }: { change: PlaceChange; done: () => void; close: () => void }) {
  const act = async () => {
    await change.act();
    done();
  };
  return (
    <Confirm {...change} act={act} close={close}>
      <p>{change.text}</p>
    </Confirm>
  );
}
