// The points of the cloud that are drawn: which are wanted for a view, which are there, and how large each is.

import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Frustum,
  Group,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Matrix4,
  type PerspectiveCamera,
  Points,
} from "three";
import { type Cloud, type CloudNode, intensityOfRun, pointsOfRun } from "./cloud";
import { spacingOf } from "./density";
import { choose, type Part } from "./levels";
import { Loads, toFree } from "./loads";
import { PointMaterial } from "./material";

const KEPT_POINTS = 4_000_000; // in memory, drawn or not

interface Drawn {
  object: Points;
  count: number;
  used: number; // the last round that drew it
  spacing: number; // metres between its points and those around them
}

export class DrawnPoints {
  readonly group = new Group();
  readonly material = new PointMaterial();
  shown = 0;
  private readonly loaded = new Map<string, Drawn>();
  private readonly loads: Loads<CloudNode, ArrayBuffer>;
  private readonly shades: Loads<CloudNode, ArrayBuffer>;
  private wanted: CloudNode[] = [];
  private round = 0;

  /** `arrived` is told when there is something new to draw. */
  constructor(
    private readonly cloud: Cloud,
    private readonly arrived: () => void,
    failed: (error: unknown) => void,
  ) {
    this.loads = new Loads(
      (run, signal) => pointsOfRun(cloud, run, signal),
      (node, data) => this.add(node, data),
      failed,
    );
    this.shades = new Loads(
      (run, signal) => intensityOfRun(cloud, run, signal),
      (node, data) => this.shade(node, data),
      failed,
    );
  }

  /** Whether points of this view, or their intensity, are still on their way. */
  get isBusy(): boolean {
    const isThere = this.isByIntensity ? this.isShaded : this.isLoaded;
    return !this.wanted.every(({ key }) => isThere(key));
  }

  private get isByIntensity(): boolean {
    return this.material.colouring === "intensity";
  }

  get visible(): Points[] {
    return [...this.loaded.values()].map(({ object }) => object).filter(({ visible }) => visible);
  }

  /** Shows what the camera wants and is there. */
  show(camera: PerspectiveCamera, pixelsPerTangent: number, mostPoints: number): void {
    this.material.pixelsPerTangent = pixelsPerTangent;
    const parts = this.chosen(camera, pixelsPerTangent, mostPoints);
    this.wanted = parts.map(({ node }) => node);
    this.round += 1;
    this.shown = 0;
    for (const { object } of this.loaded.values()) object.visible = false;
    const there = parts.filter(({ node }) => this.loaded.has(node.key));
    const spacings = spacingOf(there);
    for (const { node: { key }, count } of there) {
      const drawn = this.loaded.get(key)!;
      drawn.object.visible = true;
      drawn.object.geometry.setDrawRange(0, count);
      drawn.used = this.round;
      drawn.spacing = spacings.get(key)!;
      this.shown += count;
    }
  }

  /** Asks for what is wanted and not there. */
  load(): void {
    this.loads.want(this.wanted, this.isLoaded);
    const shaded = this.isByIntensity ? this.wanted.filter(({ key }) => this.isLoaded(key)) : [];
    this.shades.want(shaded, this.isShaded);
  }

  dispose(): void {
    this.loads.end();
    this.shades.end();
    for (const { object } of this.loaded.values()) object.geometry.dispose();
    this.material.dispose();
  }

  private readonly isLoaded = (key: string) => this.loaded.has(key);
  private readonly isShaded = (key: string) => this.loaded.get(key)?.object.geometry.hasAttribute("shade") ?? false;

  private chosen(camera: PerspectiveCamera, pixelsPerTangent: number, mostPoints: number): Part[] {
    camera.updateMatrixWorld();
    const whole = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    const frustum = new Frustum().setFromProjectionMatrix(whole);
    const box = new Box3();
    const [lowest, highest] = this.material.slice;
    const sees = (low: [number, number, number], edge: number) => {
      if (low[2] > highest || low[2] + edge < lowest) return false;
      box.min.set(...low);
      box.max.set(low[0] + edge, low[1] + edge, low[2] + edge);
      return frustum.intersectsBox(box);
    };
    return choose(this.cloud.root, { at: camera.position.toArray(), pixelsPerTangent, sees }, mostPoints);
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
    this.group.add(object);
    object.updateMatrixWorld();
    const drawn: Drawn = { object, count: node.count, used: this.round, spacing: 0 };
    object.onBeforeRender = () => {
      this.material.spacing = drawn.spacing;
    };
    this.loaded.set(node.key, drawn);
    this.forget();
    this.arrived();
  }

  private shade(node: CloudNode, data: ArrayBuffer): void {
    this.loaded.get(node.key)?.object.geometry.setAttribute("shade", new BufferAttribute(new Uint8Array(data), 1, true));
    this.arrived();
  }

  private forget(): void {
    for (const key of toFree(this.loaded, this.round, KEPT_POINTS)) {
      const { object } = this.loaded.get(key)!;
      this.group.remove(object);
      object.geometry.dispose(); // its memory on the graphics card, too
      this.loaded.delete(key);
    }
  }
}
