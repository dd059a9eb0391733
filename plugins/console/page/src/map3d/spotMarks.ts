// The self-test's grid over the map: squares by how well scans did, and lines to the places they resemble.

import { Color, Group, type Object3D } from "three";
import { token } from "../ui/token";
import { onTop, pathMark, squareMark } from "./marks";
import type { MapScene } from "./scene";
import { localizedShare, SPOT_CELL_M, type SpotCell, type SpotGrid } from "./spots";

const HEAT_OPACITY = 0.65; // the colours of the points are not to be mixed into it
const EDGE_M = 0.92 * SPOT_CELL_M;

/** The heat of localizability: the share of the scans that were localized in each cell. */
export function squares(scene: MapScene, grid: SpotGrid): Object3D {
  const group = new Group();
  for (const one of grid.cells) {
    group.add(squareMark(scene.local(grid.middle(one.cell)), SPOT_CELL_M, heatOf(localizedShare(one)).getHex(), HEAT_OPACITY));
    if (one.in_part) group.add(...crossed(scene, grid, one));
  }
  return group;
}

/** The diagonals of a cell that was mapped in part. */
function crossed(scene: MapScene, grid: SpotGrid, { cell }: SpotCell): Object3D[] {
  const ends = (rise: number) => [-0.4, 0.4].flatMap((aside) => scene.local(grid.middle(cell, aside, rise * aside)).toArray());
  return [1, -1].map((rise) => onTop(pathMark(new Float32Array(ends(rise)), token("mark-chosen"))));
}

/** From none over half to all, as the legend has it. */
function heatOf(share: number): Color {
  const [low, middle, high] = ["none", "half", "all"].map((end) => new Color(token(`heat-${end}`))) as [Color, Color, Color];
  return share < 0.5 ? low.lerp(middle, 2 * share) : middle.lerp(high, 2 * share - 1);
}

/** A line from every cell to the one that it is taken for. */
export function aliases(scene: MapScene, grid: SpotGrid): Object3D {
  const group = new Group();
  for (const one of grid.confused) group.add(between(scene, grid, one.cell, one.taken_for!, token("mark-path")));
  return group;
}

/** A cell with lines to its look-alikes, in both directions. */
export function chosen(scene: MapScene, grid: SpotGrid, one: SpotCell): Object3D {
  const group = new Group();
  group.add(squareMark(scene.local(grid.middle(one.cell)), SPOT_CELL_M, token("mark-chosen")));
  const others = grid.takenFor(one.cell).map(({ cell }) => cell);
  if (one.taken_for) others.push(one.taken_for);
  for (const other of others) {
    group.add(squareMark(scene.local(grid.middle(other)), SPOT_CELL_M, token("mark-path")));
    group.add(between(scene, grid, one.cell, other, token("mark-chosen")));
  }
  return group;
}

/** Squares by how much better (green) or worse (red) the second grid's version does; grey: as well. */
export function gains(scene: MapScene, before: SpotGrid, after: SpotGrid): Object3D {
  const group = new Group();
  for (const { one, gain } of gainsOf(before, after)) {
    const colour = token(gain > 0 ? "mark-new" : gain < 0 ? "mark-gone" : "mark-other");
    group.add(squareMark(scene.local(after.middle(one.cell)), EDGE_M, colour));
  }
  return group;
}

/** The cells that both versions tested, and the change of the localized share. */
export function gainsOf(before: SpotGrid, after: SpotGrid): { one: SpotCell; gain: number }[] {
  const found = [];
  for (const one of after.cells) {
    const old = before.at(after.middle(one.cell));
    if (old) found.push({ one, gain: localizedShare(one) - localizedShare(old) });
  }
  return found;
}

function between(
  scene: MapScene,
  grid: SpotGrid,
  from: [number, number],
  to: [number, number],
  colour: number,
): Object3D {
  const ends = [from, to].flatMap((cell) => scene.local(grid.middle(cell)).toArray());
  const line = pathMark(new Float32Array(ends), colour);
  line.material.depthTest = false; // never hidden by shelves and walls
  line.renderOrder = 5;
  return line;
}
