// Recorded queries as pins on their map. A click on one opens it.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group } from "three";
import { mapDetails } from "../api/maps";
import { MapCanvas } from "../map3d/MapCanvas";
import { type Pose, poseMark } from "../map3d/marks";
import { clear } from "../map3d/clear";
import type { MapScene } from "../map3d/scene";
import { colourOf } from "../ui/verdict";
import { useLoaded } from "../ui/useLoaded";
import { answerOf, placeIn, type RecordedQuery } from "./place";

export interface QueryPinsProps {
  map: string;
  queries: RecordedQuery[];
  pointedAt: string; // id of the query under the pointer in the table
  open: (recorded: RecordedQuery) => void;
}

export function QueryPins({ map, queries, pointedAt, open }: QueryPinsProps) {
  const details = useLoaded((signal) => mapDetails(map, signal), [map]);
  const scene = useRef<MapScene | null>(null);
  const isReady = useSignal(0);
  const marks = useRef(new Group()).current;
  const pins = queries
    .map((recorded) => ({ recorded, pose: placeIn(recorded, map) }))
    .filter((pin): pin is { recorded: RecordedQuery; pose: Pose } => pin.pose !== null);

  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    clear(marks);
    for (const { recorded, pose } of pins) {
      const size = recorded.query_id === pointedAt ? 5 : 2.5;
      marks.add(poseMark(here.local(pose.position), pose, colourOf(answerOf(recorded).verdict), size));
    }
    here.redraw();
  }, [queries, pointedAt, isReady.value]);

  const version = details.value?.active_version;
  if (!version) return null;
  return (
    <MapCanvas
      key={version}
      map={map}
      version={version}
      ready={(found) => {
        scene.current = found;
        found?.overlay.add(marks);
        if (found) found.material.colouring = "plain";
        isReady.value += 1;
      }}
      clickedAt={(x, y) => {
        const positions = pins.map(({ pose }) => pose.position);
        const pin = pins[scene.current?.nearest(positions, x, y) ?? -1];
        if (pin) open(pin.recorded);
        return pin !== undefined;
      }}
    />
  );
}
