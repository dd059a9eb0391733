// The self-test's grid over the map: squares by how well scans did, and lines to the places they resemble.

import { Color, Group, type Object3D } from "three";
import { pathMark, squareMark } from "./marks";
import type { MapScene } from "./scene";
import { localizedShare, SPOT_CELL_M, type SpotCell, type SpotGrid } from "./spots";

const EDGE_M = 0.92 * SPOT_CELL_M;
const ALIAS = 0xff9500;
const CHOSEN = 0xffffff;

/** Green where scans were localized, red where they were not. */
export function squares(scene: MapScene, grid: SpotGrid): Object3D {
  const group = new Group();
  for (const one of grid.cells) {
    const share = localizedShare(one);
    const colour = new Color(1 - share, 0.15 + 0.6 * share, 0.2).getHex();
    group.add(squareMark(scene.local(grid.middle(one.cell)), EDGE_M, colour));
  }
  return group;
}

/** A line from every cell to the one that it is taken for. */
export function aliases(scene: MapScene, grid: SpotGrid): Object3D {
  const group = new Group();
  for (const one of grid.confused) group.add(between(scene, grid, one.cell, one.taken_for!, ALIAS));
  return group;
}

/** A cell with lines to its look-alikes, in both directions. */
export function chosen(scene: MapScene, grid: SpotGrid, one: SpotCell): Object3D {
  const group = new Group();
  group.add(squareMark(scene.local(grid.middle(one.cell)), SPOT_CELL_M, CHOSEN));
  const others = grid.takenFor(one.cell).map(({ cell }) => cell);
  if (one.taken_for) others.push(one.taken_for);
  for (const other of others) {
    group.add(squareMark(scene.local(grid.middle(other)), SPOT_CELL_M, ALIAS));
    group.add(between(scene, grid, one.cell, other, CHOSEN));
  }
  return group;
}

/** Squares by how much better (green) or worse (red) the second grid's version does; grey: as well. */
export function gains(scene: MapScene, before: SpotGrid, after: SpotGrid): Object3D {
  const group = new Group();
  for (const { one, gain } of gainsOf(before, after)) {
    const colour = gain > 0 ? 0x34c759 : gain < 0 ? 0xff3b30 : 0x8899aa;
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
