// The picture of one map: a camera over the cloud, and what is laid over it. All positions that come in are of the
// map's frame; within, they are counted from the cloud's low corner, so that single precision is fine enough.

import {
  AmbientLight,
  Box3,
  BufferAttribute,
  BufferGeometry,
  Group,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Frustum,
  Matrix4,
  type Object3D,
  PerspectiveCamera,
  Points,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { MapControls } from "three/addons/controls/MapControls.js";
import { type Cloud, type CloudNode, pointsOfRun } from "./cloud";
import { framed } from "./framed";
import { choose } from "./levels";
import { Loads, toFree } from "./loads";
import { PointMaterial } from "./material";

export const KEYS = "Arrow keys move it, with Shift they turn it, + and - come nearer and go away.";
const KEY_PAN_PX = 40; // each press
const KEY_ZOOM = 0.85; // of the distance that a press leaves
const KEPT_POINTS = 4_000_000; // in memory, drawn or not

export interface View {
  target: [number, number, number];
  eye: [number, number, number];
}

export class MapScene {
  readonly overlay = new Group();
  readonly material = new PointMaterial();
  readonly camera = new PerspectiveCamera(55, 1, 0.05, 20000);
  shownPoints = 0;
  moved: (view: View) => void = () => {};
  drawn: () => void = () => {};
  failed: (error: unknown) => void = () => {};

  private readonly scene = new Scene();
  private readonly renderer: WebGLRenderer;
  private readonly controls: MapControls;
  private readonly sized = new ResizeObserver(() => this.resize());
  private readonly loaded = new Map<string, { object: Points; count: number; used: number }>();
  private readonly loads = new Loads<CloudNode, ArrayBuffer>(
    (run, signal) => pointsOfRun(this.cloud, run, signal),
    (node, data) => this.add(node, data),
    (error) => this.failed(error),
  );
  private wanted: CloudNode[] = [];
  private frame = 0;
  private isDirty = true;
  private round = 0;

  constructor(
    private readonly cloud: Cloud,
    private readonly element: HTMLElement,
  ) {
    this.renderer = new WebGLRenderer({ antialias: false, powerPreference: "high-performance" });
    this.renderer.setClearColor(0x10161b);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 1.5));
    element.append(this.renderer.domElement);
    this.renderer.domElement.tabIndex = 0;
    this.renderer.domElement.setAttribute("aria-label", `The map in 3D. ${KEYS}`);
    this.camera.up.set(0, 0, 1);
    this.controls = new MapControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = Math.PI * 0.85;
    this.controls.keyPanSpeed = KEY_PAN_PX;
    this.controls.listenToKeyEvents(this.renderer.domElement);
    this.renderer.domElement.addEventListener("keydown", ({ key }) => {
      if (key === "+" || key === "-") this.approach(key === "+" ? KEY_ZOOM : 1 / KEY_ZOOM);
    });
    this.controls.addEventListener("change", () => {
      this.redraw();
      this.moved(this.view);
    });
    this.scene.add(this.overlay, new AmbientLight(0xffffff, 3));
    const [low, high] = cloud.index.bounds_m.map((corner) => this.local(corner)) as [Vector3, Vector3];
    this.material.heights = [low.z, high.z];
    this.material.spacing = 0.05;
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
    this.controls.target.copy(this.local(target));
    this.camera.position.copy(this.local(eye));
    this.controls.update();
    this.redraw();
  }

  /** Size of a mark that is seen when the whole map is: a ball of 0.18 m has size 1. */
  get markSize(): number {
    const [low, high] = this.cloud.index.bounds_m.map((corner) => this.local(corner)) as [Vector3, Vector3];
    return Math.max(1.5, low.distanceTo(high) / 12);
  }

  /** Whether points of this view are still on their way. */
  get isBusy(): boolean {
    return this.wanted.some((node) => !this.loaded.has(node.key));
  }

  /** Looks at the whole map from the south, obliquely, from as near as shows all of it. */
  lookAtAll(): void {
    const [low, high] = this.cloud.index.bounds_m.map((corner) => this.local(corner)) as [Vector3, Vector3];
    const { target, eye } = framed(low.toArray(), high.toArray(), this.camera.fov, this.camera.aspect);
    this.controls.target.set(...target);
    this.camera.position.set(...eye);
    this.controls.update();
    this.redraw();
  }

  /** Looks at a position from a few metres away. */
  lookAt(position: readonly number[], away = 15): void {
    const at = this.local(position);
    this.controls.target.copy(at);
    this.camera.position.copy(at).add(new Vector3(0, -0.7 * away, 0.8 * away));
    this.controls.update();
    this.redraw();
  }

  /** Goes to a share of the distance from what is looked at. */
  private approach(share: number): void {
    this.camera.position.sub(this.controls.target).multiplyScalar(share).add(this.controls.target);
    this.controls.update();
    this.redraw();
  }

  get canvas(): HTMLCanvasElement {
    return this.renderer.domElement;
  }

  /** Whether dragging moves the camera. */
  set isNavigable(navigable: boolean) {
    this.controls.enabled = navigable;
  }

  redraw(): void {
    this.isDirty = true;
    if (!this.frame) this.frame = requestAnimationFrame(() => this.draw());
  }

  /** The point of the cloud that is drawn nearest to a place of the picture, within some pixels. */
  pick(clientX: number, clientY: number, withinPx = 8): [number, number, number] | null {
    const box = this.renderer.domElement.getBoundingClientRect();
    const [px, py] = [clientX - box.left, clientY - box.top];
    const project = new Matrix4();
    const whole = new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    const [low, high] = this.material.slice;
    const at = new Vector3();
    let best: Vector3 | null = null;
    let bestCost = Infinity;
    for (const { object } of this.loaded.values()) {
      if (!object.visible) continue;
      project.multiplyMatrices(whole, object.matrixWorld);
      const packed = object.geometry.getAttribute("position");
      for (let i = 0; i < packed.count; i++) {
        at.set(packed.getX(i), packed.getY(i), packed.getZ(i)).applyMatrix4(project);
        if (at.z > 1 || at.z < -1) continue;
        const dx = ((at.x + 1) / 2) * box.width - px;
        const dy = ((1 - at.y) / 2) * box.height - py;
        const away = dx * dx + dy * dy;
        if (away > withinPx * withinPx) continue;
        const cost = at.z * 1e3 + away * 1e-3; // the nearest to the eye
        if (cost >= bestCost) continue;
        const position = new Vector3(packed.getX(i), packed.getY(i), packed.getZ(i)).applyMatrix4(object.matrixWorld);
        if (position.z < low || position.z > high) continue;
        bestCost = cost;
        best = position;
      }
    }
    return best ? this.inMap(best) : null;
  }

  /** Which of some positions is drawn nearest to a place of the window, within some pixels; -1: none. */
  nearest(positions: readonly (readonly number[])[], clientX: number, clientY: number, withinPx = 14): number {
    const box = this.renderer.domElement.getBoundingClientRect();
    let best = -1;
    let bestPx = withinPx;
    positions.forEach((position, i) => {
      const at = this.local(position).project(this.camera);
      if (at.z > 1) return; // behind the eye
      const [x, y] = [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
      const away = Math.hypot(x - clientX, y - clientY);
      if (away <= bestPx) [best, bestPx] = [i, away];
    });
    return best;
  }

  dispose(): void {
    this.loads.end();
    this.sized.disconnect();
    cancelAnimationFrame(this.frame);
    this.controls.dispose();
    for (const { object } of this.loaded.values()) object.geometry.dispose();
    clear(this.overlay);
    this.material.dispose();
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.element;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  private draw(): void {
    this.frame = 0;
    if (!this.isDirty) return;
    this.isDirty = false;
    const canvas = this.renderer.domElement;
    const perTangent = canvas.height / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
    this.material.pixelsPerTangent = perTangent;
    this.wanted = this.chosen(perTangent);
    this.round += 1;
    for (const { object } of this.loaded.values()) object.visible = false;
    this.shownPoints = 0;
    for (const node of this.wanted) {
      const there = this.loaded.get(node.key);
      if (!there) continue;
      there.object.visible = true;
      there.used = this.round;
      this.shownPoints += there.count;
    }
    this.renderer.render(this.scene, this.camera);
    this.loads.want(this.wanted, (key) => this.loaded.has(key));
    this.drawn();
  }

  private chosen(pixelsPerTangent: number): CloudNode[] {
    this.camera.updateMatrixWorld();
    const frustum = new Frustum().setFromProjectionMatrix(
      new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse),
    );
    const box = new Box3();
    const [lowest, highest] = this.material.slice;
    return choose(this.cloud.root, {
      at: this.camera.position.toArray(),
      pixelsPerTangent,
      sees: (low, edge) => {
        if (low[2] > highest || low[2] + edge < lowest) return false;
        box.min.set(...low);
        box.max.set(low[0] + edge, low[1] + edge, low[2] + edge);
        return frustum.intersectsBox(box);
      },
    });
  }

  private add(node: CloudNode, data: ArrayBuffer): void {
    const geometry = new BufferGeometry();
    const positions = new InterleavedBuffer(new Uint16Array(data), 4);
    geometry.setAttribute("position", new InterleavedBufferAttribute(positions, 3, 0, true));
    const bends = new InterleavedBuffer(new Int8Array(data), 8);
    geometry.setAttribute("bend", new InterleavedBufferAttribute(bends, 2, 6, true));
    const object = new Points(geometry, this.material);
    object.position.set(...node.low);
    object.scale.setScalar(node.edge);
    object.frustumCulled = false;
    this.scene.add(object);
    object.updateMatrixWorld();
    this.loaded.set(node.key, { object, count: node.count, used: this.round });
    this.forget();
    this.redraw();
  }

  private forget(): void {
    for (const key of toFree(this.loaded, this.round, KEPT_POINTS)) {
      const { object } = this.loaded.get(key)!;
      this.scene.remove(object);
      object.geometry.dispose(); // its memory on the graphics card, too
      this.loaded.delete(key);
    }
  }
}

/** Removes and frees all that a group holds. */
export function clear(group: Object3D): void {
  group.traverse((one) => {
    const held = one as Partial<Points>;
    held.geometry?.dispose();
  });
  group.clear();
}

/** Geometry of (x, y, z) positions that are counted from the cloud's low corner. */
export function geometryOf(positions: Float32Array): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  return geometry;
}
