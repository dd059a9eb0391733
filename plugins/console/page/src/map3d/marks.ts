// What is laid over the cloud: poses, paths, templates, a scan, cells.

import {
  ArrowHelper,
  Box3,
  Box3Helper,
  BoxGeometry,
  BufferGeometry,
  Color,
  DoubleSide,
  Group,
  InstancedMesh,
  Line,
  LineBasicMaterial,
  LineLoop,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  type Object3D,
  PlaneGeometry,
  Points,
  PointsMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
  BufferAttribute,
} from "three";
import { token } from "../ui/token";

const RING_PARTS = 96;
const DOT_PX = 7;
const PROJECTION = "#include <project_vertex>";
const NEARER = 0.99; // of the distance to the eye

export interface Pose {
  position: number[];
  quaternion: number[];
}

/** The axes of a sensor with a ball at its place. */
export function poseMark(at: Vector3, pose: Pose, colour: number, size = 1): Group {
  const group = new Group();
  const [x, y, z, w] = pose.quaternion as [number, number, number, number];
  const turn = new Quaternion(x, y, z, w);
  const ball = new Mesh(
    new SphereGeometry(0.18 * size, 16, 12),
    new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true }),
  );
  ball.renderOrder = 10;
  ball.position.copy(at);
  const dot = dotsMark(new Float32Array(at.toArray()), colour, DOT_PX); // what is left of it from far away
  group.add(ball, onTop(dot));
  const axes: [Vector3, number, number][] = [
    [new Vector3(1, 0, 0), colour, 1.4],
    [new Vector3(0, 0, 1), token("mark-other"), 0.7],
  ];
  for (const [axis, tint, length] of axes) {
    const arrow = new ArrowHelper(axis.applyQuaternion(turn), at, length * size, tint, 0.35 * size, 0.22 * size);
    group.add(onTop(arrow));
  }
  return group;
}

/** The same mark, never hidden by the cloud. */
export function onTop<T extends Object3D>(mark: T): T {
  mark.traverse((part) => {
    part.renderOrder = 10;
    const { material } = part as Partial<Mesh>;
    if (material && !Array.isArray(material)) material.depthTest = false;
  });
  return mark;
}

export function pathMark(positions: Float32Array, colour: number): Line<BufferGeometry, LineBasicMaterial> {
  return new Line(geometryOf(positions), new LineBasicMaterial({ color: colour }));
}

/** A level circle around the origin. */
export function ringMark(radius: number, colour: number): LineLoop {
  const positions = new Float32Array(3 * RING_PARTS);
  for (let i = 0; i < RING_PARTS; i++) {
    const angle = (2 * Math.PI * i) / RING_PARTS;
    positions.set([radius * Math.cos(angle), radius * Math.sin(angle), 0], 3 * i);
  }
  const ring = new LineLoop(geometryOf(positions), new LineBasicMaterial({ color: colour, depthTest: false }));
  ring.renderOrder = 10;
  return ring;
}

export function dotsMark(positions: Float32Array, colour: number, sizePx = 3): Points<BufferGeometry, PointsMaterial> {
  return new Points(
    geometryOf(positions),
    new PointsMaterial({ color: colour, size: sizePx, sizeAttenuation: false }),
  );
}

/** Dots that stand for points of the cloud: drawn a little nearer to the eye, so that those points do not hide them. */
export function dotsOver(positions: Float32Array, colour: number, sizePx: number): Points<BufferGeometry, PointsMaterial> {
  const dots = dotsMark(positions, colour, sizePx);
  dots.material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace(
      PROJECTION,
      `${PROJECTION}\n gl_Position = projectionMatrix * vec4(${NEARER.toFixed(2)} * mvPosition.xyz, 1.0);`,
    );
  };
  return dots;
}

/** Dots with a colour each: (r, g, b) of 0..1, as three.js counts light (linear), one after the other. */
export function colouredDots(positions: Float32Array, colours: Float32Array, sizePx = 3): Points {
  const geometry = geometryOf(positions);
  geometry.setAttribute("color", new BufferAttribute(colours, 3));
  return new Points(geometry, new PointsMaterial({ size: sizePx, sizeAttenuation: false, vertexColors: true }));
}

/** A square that lies flat, around its middle. */
export function squareMark(middle: Vector3, edge: number, colour: number, opacity = 0.4): Mesh {
  const square = new Mesh(
    new PlaneGeometry(edge, edge),
    new MeshBasicMaterial({ color: colour, transparent: true, opacity, depthTest: false, side: DoubleSide }),
  );
  square.position.copy(middle);
  square.renderOrder = 4;
  return square;
}

/** Cubes of one edge at the given low corners. */
export function cellsMark(corners: Vector3[], edge: number, colour: number): InstancedMesh {
  const mesh = new InstancedMesh(
    new BoxGeometry(edge, edge, edge),
    new MeshBasicMaterial({ color: new Color(colour), transparent: true, opacity: 0.45, depthWrite: false }),
    corners.length,
  );
  const half = new Vector3(edge / 2, edge / 2, edge / 2);
  corners.forEach((corner, i) => {
    const middle = corner.clone().add(half);
    mesh.setMatrixAt(i, new Matrix4().makeTranslation(middle));
  });
  return mesh;
}

/** The edges of a box between its lowest and highest corner, never hidden by the cloud. */
export function outlineMark(low: Vector3, high: Vector3, colour: number): Object3D {
  return onTop(new Box3Helper(new Box3(low, high), colour));
}

/** Geometry of (x, y, z) positions that are counted from the cloud's low corner. */
function geometryOf(positions: Float32Array): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  return geometry;
}
