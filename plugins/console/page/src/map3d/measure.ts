// Measuring a distance: two points, a line between them.

import { Group, Vector3 } from "three";
import { token } from "../ui/token";
import { dotsMark, pathMark } from "./marks";
import { clear } from "./clear";
import type { MapScene } from "./scene";

export class Measure {
  private readonly group = new Group();
  private ends: Vector3[] = [];

  constructor(
    private readonly scene: MapScene,
    private readonly told: (m: number | null) => void,
  ) {
    scene.overlay.add(this.group);
  }

  add(position: [number, number, number]): void {
    if (this.ends.length === 2) this.clear();
    this.ends.push(this.scene.local(position));
    const flat = new Float32Array(this.ends.flatMap((end) => end.toArray()));
    clear(this.group);
    this.group.add(dotsMark(flat, token("mark-measure"), 9));
    if (this.ends.length === 2) this.group.add(pathMark(flat, token("mark-measure")));
    this.told(this.ends.length === 2 ? this.ends[0]!.distanceTo(this.ends[1]!) : null);
    this.scene.redraw();
  }

  clear(): void {
    this.ends = [];
    clear(this.group);
    this.told(null);
    this.scene.redraw();
  }
}
