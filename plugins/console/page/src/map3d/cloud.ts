// The cloud of a version: which nodes there are, and their points.

import { type CloudIndex, cloudIndex, cloudIntensity, cloudPoints } from "../api/maps";

export interface CloudNode {
  key: string;
  level: number;
  low: [number, number, number]; // from the root's low corner, metres
  edge: number;
  first: number;
  count: number;
  children: CloudNode[];
}

/** The octree as the viewer walks it. */
export interface Cloud {
  map: string;
  version: string;
  index: Omit<CloudIndex, "low_m" | "nodes"> & { low_m: [number, number, number] };
  root: CloudNode;
}

export async function openCloud(map: string, version: string, signal: AbortSignal): Promise<Cloud> {
  const { nodes, low_m, ...index } = await cloudIndex(map, version, signal);
  const found = new Map<string, CloudNode>();
  for (const [level = 0, x = 0, y = 0, z = 0, first = 0, count = 0] of nodes) {
    const edge = index.edge_m / 2 ** level;
    const node: CloudNode = {
      key: `${level}/${x}/${y}/${z}`,
      level,
      low: [x * edge, y * edge, z * edge],
      edge,
      first,
      count,
      children: [],
    };
    found.set(node.key, node);
    if (level > 0) found.get(`${level - 1}/${x >> 1}/${y >> 1}/${z >> 1}`)?.children.push(node);
  }
  const root = found.get("0/0/0/0");
  if (!root) throw new Error("the cloud has no points");
  const [x = 0, y = 0, z = 0] = low_m;
  return { map, version, index: { ...index, low_m: [x, y, z] }, root };
}

const MAX_AT_ONCE = 500_000; // points that the service gives in one answer

/** Points as they come: x, y, z as uint16 in 1/65535 of the node's edge, then two int8 of the normal. */
export function points(cloud: Cloud, first: number, count: number, signal?: AbortSignal): Promise<ArrayBuffer> {
  return inParts(cloud, cloudPoints, cloud.index.point_bytes, first, count, signal);
}

/** `points` of each of some nodes, which stand one after the other. */
export function pointsOfRun(cloud: Cloud, run: CloudNode[], signal?: AbortSignal): Promise<ArrayBuffer[]> {
  return ofRun(cloud, cloudPoints, cloud.index.point_bytes, run, signal);
}

/** The intensity of the points of each of some nodes, which stand one after the other: a byte a point. */
export function intensityOfRun(cloud: Cloud, run: CloudNode[], signal?: AbortSignal): Promise<ArrayBuffer[]> {
  return ofRun(cloud, cloudIntensity, 1, run, signal);
}

async function ofRun(cloud: Cloud, read: typeof cloudPoints, bytes: number, run: CloudNode[], signal?: AbortSignal) {
  const from = run[0]!.first;
  const count = run.reduce((sum, node) => sum + node.count, 0);
  const all = await inParts(cloud, read, bytes, from, count, signal);
  const at = (point: number) => (point - from) * bytes;
  return run.map(({ first, count: own }) => all.slice(at(first), at(first + own)));
}

async function inParts(cloud: Cloud, read: typeof cloudPoints, bytes: number, first: number, count: number, signal?: AbortSignal) {
  const found = new Uint8Array(count * bytes);
  for (let done = 0; done < count; done += MAX_AT_ONCE) {
    const part = Math.min(MAX_AT_ONCE, count - done);
    const answer = await read(cloud.map, cloud.version, first + done, part, signal);
    found.set(new Uint8Array(answer), done * bytes);
  }
  return found.buffer;
}

/** Positions of a mark, metres from the root's low corner: (x, y, z) one after the other. */
export async function mark(cloud: Cloud, name: string, signal?: AbortSignal): Promise<Float32Array> {
  const [first = 0, count = 0] = cloud.index.marks[name] ?? [];
  const packed = new Uint16Array(await points(cloud, first, count, signal));
  const found = new Float32Array(count * 3);
  const scale = cloud.index.edge_m / 65535;
  for (let i = 0; i < count; i++)
    for (let axis = 0; axis < 3; axis++) found[3 * i + axis] = (packed[4 * i + axis] ?? 0) * scale;
  return found;
}

/** Positions from the root's low corner in the map's frame. */
export function mapPositions(cloud: Cloud, positions: Float32Array): Float64Array {
  return Float64Array.from(positions, (m, i) => m + cloud.index.low_m[i % 3]!);
}
