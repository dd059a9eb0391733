// Where the second of two versions localizes better or worse than the first, on the map of the second.

import { useSignal } from "@preact/signals";
import { MapCanvas } from "../map3d/MapCanvas";
import { type Cloud, mapPositions, mark } from "../map3d/cloud";
import type { MapScene } from "../map3d/scene";
import { gains, gainsOf } from "../map3d/spotMarks";
import { spotGrid } from "../map3d/spots";
import { ErrorText } from "../ui/ErrorText";

export function Difference({ map, versions: [first, second] }: { map: string; versions: [string, string] }) {
  const told = useSignal("");
  const problem = useSignal<unknown>(null);
  const draw = async (scene: MapScene, cloud: Cloud) => {
    const templates = mapPositions(cloud, await mark(cloud, "templates"));
    const [before, after] = await Promise.all([first, second].map((one) => spotGrid(map, one, templates)));
    const found = gainsOf(before!, after!);
    const better = found.filter(({ gain }) => gain > 0).length;
    const worse = found.filter(({ gain }) => gain < 0).length;
    told.value = found.length
      ? `Of ${found.length} places that both self-tests have, the second localizes better at ${better} (green), worse at ${worse} (red).`
      : "The self-tests share no place.";
    scene.overlay.add(gains(scene, before!, after!));
    scene.redraw();
  };
  return (
    <>
      <h3>Where it localizes better or worse</h3>
      <p role="status">{told.value}</p>
      {problem.value ? <ErrorText error={problem.value} /> : null}
      <MapCanvas
        map={map}
        version={second}
        ready={(scene, cloud) => {
          if (!scene || !cloud) return;
          scene.material.colouring = "plain";
          draw(scene, cloud).catch((error: unknown) => (problem.value = error));
        }}
      />
    </>
  );
}
