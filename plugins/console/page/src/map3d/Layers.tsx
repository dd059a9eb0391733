// The switches of the map view: colour, storey, layers.

import type { Signal } from "@preact/signals";
import { mayBuild } from "../access/session";
import type { Colouring } from "./material";
import type { Storey } from "./storeys";

export type LayerName = "trajectory" | "templates" | "localizability" | "aliases" | "changes" | "recorded";

const LAYERS: Record<LayerName, string> = {
  trajectory: "Mapping run",
  templates: "Templates",
  localizability: "Where a robot finds itself",
  aliases: "Which place is taken for which",
  changes: "Changes since the map was made",
  recorded: "Recorded queries, by verdict",
};
export const LAYER_NAMES = Object.keys(LAYERS) as LayerName[];
const NOTHING: Record<LayerName, string> = {
  trajectory: "this version was built without one",
  templates: "this version has none",
  localizability: "this version has no self-test",
  aliases: "none was",
  changes: "",
  recorded: "none with a place was recorded",
};
const COLOURS: Record<Colouring, string> = { height: "Height above the floor", storey: "Storey", normal: "Normal", plain: "One colour" };

export interface LayersProps {
  colouring: Signal<Colouring>;
  layers: Signal<LayerName[]>;
  empty: LayerName[]; // those that are on and have nothing to show
  storeys: Storey[];
  storey: Signal<string>;
  whole: () => void;
  above: () => void;
}

export function Layers({ colouring, layers, empty, storeys, storey, whole, above }: LayersProps) {
  const toggle = (name: LayerName) => {
    const on = layers.value.includes(name);
    layers.value = on ? layers.value.filter((one) => one !== name) : [...layers.value, name];
  };
  const colours = Object.entries(COLOURS).filter(([value]) => value !== "storey" || storeys.length > 1);
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
          {empty.includes(name) ? <small role="status">{NOTHING[name]}</small> : null}
        </label>
      ))}
    </section>
  );
}
