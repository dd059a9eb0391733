// All maps that the caller sees: how good they are, how they do, what needs a person, and what can be done with them.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import { mapPage } from "../api/maps";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { SortHead } from "../ui/SortHead";
import { usePolled } from "../ui/usePolled";
import { useAnswerCounts } from "./answerCounts";
import { BuildForm } from "./BuildForm";
import { Builds } from "./Builds";
import { DeleteMap } from "./DeleteMap";
import { MapRow } from "./MapRow";
import { Needs } from "./Needs";
import { type Column, type Order, sorted } from "./sorted";

const LOOK_MS = 5000;
const PICTURES = 60; // of the first maps: each is a request
const NUMBERS: Column[] = ["localized", "wrong"];

export function MapList() {
  const maps = usePolled(mapPage, [], LOOK_MS);
  const counts = useAnswerCounts();
  const words = useSignal("");
  const order = useSignal<Order>({ column: "map", isDown: false });
  const building = useSignal<string | null>(null); // the map that gets a new version; "": a new map
  const doomed = useSignal<string | null>(null);
  if (maps.error && !maps.value) return <ErrorText error={maps.error} again={maps.again} />;
  if (!maps.value) return <p role="status">Reading the maps …</p>;
  const shown = sorted(maps.value.maps, counts, words.value, order.value);
  const sortBy = (column: Column) => {
    const isAgain = order.value.column === column;
    order.value = { column, isDown: isAgain ? !order.value.isDown : column !== "map" };
  };
  const columns: [Column, string][] = [
    ["map", "Map"],
    ["localized", "Localized in its self-test"],
    ["wrong", "Sure and wrong"],
    ...(mayBuild.value ? ([["hour", "Asked in the last hour"], ["day", "in the last day"]] as [Column, string][]) : []),
    ["published", "Active version"],
    ["size", "Size"],
  ];
  return (
    <main class="page">
      <header class="row">
        <h1>Maps</h1>
        {mayBuild.value ? (
          <button class="primary" onClick={() => (building.value = "")}>
            Build a map
          </button>
        ) : null}
        {maps.value.maps.length > 1 ? (
          <label class="find">
            Find
            <input type="search" placeholder="a part of the name" onInput={(event) => (words.value = event.currentTarget.value)} />
          </label>
        ) : null}
      </header>
      {maps.error ? <ErrorText error={maps.error} again={maps.again} /> : null}
      <Needs maps={maps.value.maps} counts={counts} />
      {building.value !== null ? (
        <BuildForm named={building.value} maps={maps.value.maps} close={() => (building.value = null)} />
      ) : null}
      {mayBuild.value ? <Builds maps={maps.value.maps} done={maps.again} again={(map) => (building.value = map)} /> : null}
      {shown.length ? (
        <table class="cards maps">
          <thead>
            <tr>
              {columns.map(([column, name]) => (
                <SortHead
                  key={column}
                  isSorted={order.value.column === column}
                  isDown={order.value.isDown}
                  isNumber={NUMBERS.includes(column)}
                  sort={() => sortBy(column)}
                >
                  {name}
                </SortHead>
              ))}
              <th>
                <span class="unseen">Actions</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {shown.map((one, i) => (
              <MapRow
                key={`${one.map_id} ${one.active_version}`}
                one={one}
                counts={counts.get(one.map_id)}
                hasPicture={i < PICTURES}
                remove={() => (doomed.value = one.map_id)}
              />
            ))}
          </tbody>
        </table>
      ) : maps.value.maps.length ? (
        <p role="status">No map has {words.value} in its name.</p>
      ) : (
        <Empty title="No map yet">
          <p>
            {mayBuild.value
              ? "Build one from a cloud, a mesh or a SLAM folder: PLY, PCD, LAS, LAZ, E57, OBJ, STL or a zip."
              : "Somebody whose key has the scope build has to build one."}
          </p>
        </Empty>
      )}
      {doomed.value ? (
        <DeleteMap
          map={doomed.value}
          close={() => (doomed.value = null)}
          done={maps.again}
        />
      ) : null}
    </main>
  );
}
