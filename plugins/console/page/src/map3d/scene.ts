// The picture of one map: a camera over the cloud, and what is laid over it. All positions that come in are of the
// map's frame; within, they are counted from the cloud's low corner, so that single precision is fine enough.

import { AmbientLight, Group, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { MapControls } from "three/addons/controls/MapControls.js";
import { token } from "../ui/token";
import type { Box } from "./bulk";
import { type KeyAction, KEYS, listen } from "./cameraKeys";
import { clear } from "./clear";
import type { Cloud } from "./cloud";
import { DrawnPoints } from "./drawnPoints";
import { EyeDome } from "./eyeDome";
import { framed, fromAbove, type View } from "./framed";
import { Frames } from "./frames";
import type { PointMaterial } from "./material";
import { type Orientation, orientationOf } from "./orientation";
import { nearestOf, pointAt } from "./pick";

const KEY_PAN_PX = 40; // each press
const MOST_PIXEL_RATIO = 1.5; // a picture of points gains nothing by more
const KEY_ZOOM = 0.85; // of the distance that a press leaves

export class MapScene {
  readonly overlay = new Group();
  readonly camera = new PerspectiveCamera(55, 1, 0.05, 20000);
  readonly points: DrawnPoints;
  moved: (view: View) => void = () => {};
  drawn: () => void = () => {};
  failed: (error: unknown) => void = () => {};
  keysAsked: () => void = () => {};

  private readonly cloudScene = new Scene();
  private readonly overScene = new Scene();
  private readonly renderer: WebGLRenderer;
  private readonly eyeDome: EyeDome;
  private readonly controls: MapControls;
  private readonly sized = new ResizeObserver(() => this.resize());
  private readonly unlisten: () => void;
  private readonly frames = new Frames((mostPoints, sharpness) => this.draw(mostPoints, sharpness));

  /** `bulk` is the part of the map that is framed. */
  constructor(
    private readonly cloud: Cloud,
    readonly bulk: Box,
    private readonly element: HTMLElement,
  ) {
    this.points = new DrawnPoints(cloud, () => this.redraw(), (error) => this.failed(error));
    this.renderer = new WebGLRenderer({ antialias: false, powerPreference: "high-performance" });
    this.renderer.setClearColor(token("picture-ground"));
    this.eyeDome = new EyeDome(this.renderer);
    element.append(this.canvas);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("aria-label", `The map in 3D. ${KEYS}`);
    this.camera.up.set(0, 0, 1);
    this.controls = new MapControls(this.camera, this.canvas);
    Object.assign(this.controls, { enableDamping: false, maxPolarAngle: Math.PI * 0.85, keyPanSpeed: KEY_PAN_PX });
    this.controls.listenToKeyEvents(this.canvas);
    this.unlisten = listen(this.canvas, (action) => this.act(action));
    this.controls.addEventListener("start", () => this.frames.hold(true));
    this.controls.addEventListener("end", () => this.frames.hold(false));
    this.controls.addEventListener("change", () => {
      this.frames.moved();
      this.moved(this.view);
    });
    this.cloudScene.add(this.points.group);
    this.overScene.add(this.overlay, new AmbientLight("white", 3));
    this.sized.observe(element);
    this.resize();
    this.lookAtAll();
  }

  /** A position of the map's frame as the scene counts it. */
  local([x, y, z]: readonly number[]): Vector3 {
    const [x0, y0, z0] = this.cloud.index.low_m;
    return new Vector3(x! - x0, y! - y0, z! - z0);
  }

  /** A position of the scene in the map's frame. */
  inMap(at: Vector3): [number, number, number] {
    const [x0, y0, z0] = this.cloud.index.low_m;
    return [at.x + x0, at.y + y0, at.z + z0];
  }

  get view(): View {
    return { target: this.inMap(this.controls.target), eye: this.inMap(this.camera.position) };
  }

  set view({ target, eye }: View) {
    this.look({ target: this.local(target).toArray(), eye: this.local(eye).toArray() });
  }

  /** Size of a mark that is seen when the whole map is: a ball of 0.18 m has size 1. */
  get markSize(): number {
    const [low, high] = this.bulk.map((corner) => new Vector3(...corner)) as [Vector3, Vector3];
    return Math.max(1.5, low.distanceTo(high) / 12);
  }

  /** Looks at the whole map from the south, obliquely, from as near as shows all of it. */
  lookAtAll(): void {
    this.look(framed(...this.bulk, this.camera.fov, this.camera.aspect));
  }

  /** Looks at the whole map straight from above, north (y) up. */
  lookFromAbove(): void {
    this.look(fromAbove(...this.bulk, this.camera.fov, this.camera.aspect));
  }

  /** Looks at a position from a few metres away. */
  lookAt(position: readonly number[], away = 15): void {
    const target = this.local(position).toArray();
    this.look({ target, eye: [target[0], target[1] - 0.7 * away, target[2] + 0.8 * away] });
  }

  /** Looks at a position from so far, or at the whole map where that is seen from nearer. */
  lookAround(position: readonly number[], away: number): void {
    const [low, high] = this.bulk;
    const at = this.local(position).toArray();
    const isWithin = at.every((m, axis) => m >= low[axis]! && m <= high[axis]!);
    const whole = framed(low, high, this.camera.fov, this.camera.aspect);
    if (isWithin && new Vector3(...whole.eye).distanceTo(new Vector3(...whole.target)) < away) this.look(whole);
    else this.lookAt(position, away);
  }

  get orientation(): Orientation {
    return orientationOf(this.camera, this.controls.target, this.element.clientHeight);
  }

  get material(): PointMaterial {
    return this.points.material;
  }

  /** Whether the picture of this view will show more points. */
  get isBusy(): boolean {
    return this.points.isBusy || this.frames.isReduced;
  }

  get canvas(): HTMLCanvasElement {
    return this.renderer.domElement;
  }

  /** Whether dragging moves the camera. */
  set isNavigable(navigable: boolean) {
    this.controls.enabled = navigable;
  }

  redraw(): void {
    this.frames.redraw();
  }

  /** The point of the cloud that is drawn nearest to a place of the window, within some pixels. */
  pick(clientX: number, clientY: number, withinPx = 8): [number, number, number] | null {
    const found = pointAt(this, this.points.visible, this.material.slice, clientX, clientY, withinPx);
    return found && this.inMap(found);
  }

  /** Which of some positions is drawn nearest to a place of the window, within some pixels; -1: none. */
  nearest(positions: readonly (readonly number[])[], clientX: number, clientY: number, withinPx = 14): number {
    return nearestOf(this, positions.map((one) => this.local(one)), clientX, clientY, withinPx);
  }

  dispose(): void {
    this.unlisten();
    this.sized.disconnect();
    this.frames.dispose();
    this.controls.dispose();
    this.points.dispose();
    this.eyeDome.dispose();
    clear(this.overlay);
    this.renderer.dispose();
    this.canvas.remove();
  }

  /** The low corner of the cloud in the map's frame: what the scene counts from. */
  get origin(): [number, number, number] {
    return this.cloud.index.low_m;
  }

  private act(action: KeyAction): void {
    if (action === "list") this.keysAsked();
    else if (action === "above") this.lookFromAbove();
    else if (action === "whole") this.lookAtAll();
    else this.approach(action === "nearer" ? KEY_ZOOM : 1 / KEY_ZOOM);
  }

  /** Goes to a share of the distance from what is looked at. */
  private approach(share: number): void {
    this.camera.position.sub(this.controls.target).multiplyScalar(share).add(this.controls.target);
    this.controls.update();
  }

  /** `target` and `eye` as the scene counts them. */
  private look({ target, eye }: View): void {
    this.controls.target.set(...target);
    this.camera.position.set(...eye);
    this.controls.update();
    this.redraw();
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.element;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  private draw(mostPoints: number, sharpness: number): number {
    const pixelRatio = sharpness * Math.min(devicePixelRatio, MOST_PIXEL_RATIO);
    if (this.renderer.getPixelRatio() !== pixelRatio) this.renderer.setPixelRatio(pixelRatio);
    this.points.show(this.camera, this.canvas.height / (2 * Math.tan((this.camera.fov * Math.PI) / 360)), mostPoints);
    this.eyeDome.render(this.cloudScene, this.overScene, this.camera);
    this.points.load();
    this.drawn();
    return this.points.shown;
  }
}
