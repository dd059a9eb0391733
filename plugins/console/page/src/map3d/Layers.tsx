// The switches of the map view: colour, storey, layers.

import type { Signal } from "@preact/signals";
import { mayBuild } from "../access/session";
import { type Colouring, SIZES_PX } from "./material";
import type { Storey } from "./storeys";

export type LayerName = "grid" | "trajectory" | "templates" | "localizability" | "aliases" | "changes" | "recorded";

const LAYERS: Record<LayerName, string> = {
  grid: "Grid on the floor",
  trajectory: "Mapping run",
  templates: "Templates",
  localizability: "Where a robot finds itself",
  aliases: "Which place is taken for which",
  changes: "Changes since the map was made",
  recorded: "Recorded queries, by verdict",
};
export const LAYER_NAMES = Object.keys(LAYERS) as LayerName[];
const NOTHING: Record<LayerName, string> = {
  grid: "",
  trajectory: "this version was built without one",
  templates: "this version has none",
  localizability: "this version has no self-test",
  aliases: "none was",
  changes: "",
  recorded: "none with a place was recorded",
};
const COLOURS: Record<Colouring, string> = { height: "Height above the floor", intensity: "Intensity", storey: "Storey", normal: "Normal", plain: "One colour" };

export interface LayersProps {
  colouring: Signal<Colouring>;
  largestPx: Signal<number>; // of a point that is near
  layers: Signal<LayerName[]>;
  empty: LayerName[]; // those that are on and have nothing to show
  gridM: number | null; // between the lines of the grid
  hasIntensity: boolean;
  storeys: Storey[];
  storey: Signal<string>;
  whole: () => void;
  above: () => void;
}

/** Whether the points are grey: over a rainbow nobody could read the heat of places, or red for what has gone. */
export function isGreyBelow(layers: readonly string[]): boolean {
  return layers.includes("localizability") || layers.includes("changes");
}

export function Layers({ colouring, largestPx, layers, empty, gridM, hasIntensity, storeys, storey, whole, above }: LayersProps) {
  const toggle = (name: LayerName) => {
    const on = layers.value.includes(name);
    layers.value = on ? layers.value.filter((one) => one !== name) : [...layers.value, name];
  };
  const isThere: Partial<Record<string, boolean>> = { intensity: hasIntensity, storey: storeys.length > 1 };
  const colours = Object.entries(COLOURS).filter(([value]) => isThere[value] ?? true);
  return (
    <section>
      <h3>View</h3>
      <div class="row">
        <button onClick={whole}>Whole map</button>
        <button onClick={above}>From above</button>
      </div>
      <label>
        Colour
        <select
          value={colouring.value}
          onChange={(event) => (colouring.value = event.currentTarget.value as Colouring)}
        >
          {colours.map(([value, name]) => (
            <option value={value} key={value}>
              {name}
            </option>
          ))}
        </select>
      </label>
      {isGreyBelow(layers.value) ? <small>The points are grey below the colours of what is laid over them.</small> : null}
      <label>
        Point size, at most {largestPx.value} px
        <input
          type="range"
          min={SIZES_PX[0]}
          max={SIZES_PX[1]}
          value={largestPx.value}
          onInput={(event) => (largestPx.value = Number(event.currentTarget.value))}
        />
      </label>
      {storeys.length > 1 ? (
        <label>
          Storeys shown
          <select value={storey.value} onChange={(event) => (storey.value = event.currentTarget.value)}>
            <option value="">All</option>
            {storeys.map((one, i) => (
              <option value={String(i + 1)} key={one.name}>
                {one.name}
              </option>
            ))}
          </select>
        </label>
      ) : null}
      <h3>Layers</h3>
      {LAYER_NAMES.filter((name) => name !== "recorded" || mayBuild.value).map((name) => (
        <label class="check" key={name}>
          <input type="checkbox" checked={layers.value.includes(name)} onChange={() => toggle(name)} />
          {LAYERS[name]}
          {name === "grid" && gridM ? <small>a line each {gridM} m</small> : null}
          {empty.includes(name) ? <small role="status">{NOTHING[name]}</small> : null}
        </label>
      ))}
    </section>
  );
}
