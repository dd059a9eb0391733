// A pose that is dragged: moved along the map's axes, turned about its own.

import { Group, Object3D, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { token } from "../ui/token";
import { type Pose, poseMark, ringMark } from "./marks";
import { clear } from "./clear";
import type { MapScene } from "./scene";

export type HandleMode = "translate" | "rotate";
const LEVEL: Pose = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };

export class PoseHandle {
  private readonly object = new Object3D();
  private readonly shape = new Group();
  private readonly controls: TransformControls;

  /** `moved` is told each pose on the way, and whether it is the last one of the drag. */
  constructor(
    private readonly scene: MapScene,
    moved: (pose: Pose, isDone: boolean) => void,
  ) {
    this.controls = new TransformControls(scene.camera, scene.canvas);
    scene.overlay.add(this.object, this.controls.getHelper());
    this.object.add(this.shape);
    this.controls.attach(this.object);
    this.controls.addEventListener("change", () => scene.redraw());
    this.controls.addEventListener("objectChange", () => moved(this.pose, false));
    this.controls.addEventListener("dragging-changed", ({ value }) => {
      scene.isNavigable = !value;
      if (!value) moved(this.pose, true);
    });
    this.mode = "translate";
  }

  set mode(mode: HandleMode) {
    this.controls.setMode(mode);
    this.controls.setSpace(mode === "rotate" ? "local" : "world");
    this.scene.redraw();
  }

  get pose(): Pose {
    return { position: this.scene.inMap(this.object.position), quaternion: this.object.quaternion.toArray() };
  }

  /** Puts the handle at a pose, with a ring around all places that are allowed. */
  place(pose: Pose, radius: number): void {
    if (!this.controls.dragging) {
      this.object.position.copy(this.scene.local(pose.position));
      this.object.quaternion.fromArray(pose.quaternion);
    }
    clear(this.shape);
    this.shape.add(poseMark(new Vector3(), LEVEL, token("mark-hand"), 2));
    const ring = ringMark(radius, token("mark-hand"));
    ring.quaternion.copy(this.object.quaternion).invert(); // level in the map
    this.shape.add(ring);
    this.scene.redraw();
  }

  dispose(): void {
    this.controls.detach();
    this.controls.dispose();
    this.scene.isNavigable = true;
    clear(this.object);
    this.scene.overlay.remove(this.object, this.controls.getHelper());
    this.scene.redraw();
  }
}
