// LAS: the positions of its points. LAZ, its compressed form, is read by the command line alone.

import type { Points } from "./points";

const COMPRESSED = 0x80; // in the byte of the point format

export function las(body: ArrayBuffer): Points {
  const view = new DataView(body);
  if (body.byteLength < 227 || new TextDecoder().decode(body.slice(0, 4)) !== "LASF") {
    throw new Error("it is no LAS file: it does not begin as one");
  }
  if (view.getUint8(104) & COMPRESSED) return laz();
  const isNew = view.getUint8(25) >= 4 && body.byteLength >= 375;
  const count = isNew ? Number(view.getBigUint64(247, true)) : view.getUint32(107, true);
  const first = view.getUint32(96, true);
  const length = view.getUint16(105, true);
  if (length < 12 || first + count * length > body.byteLength) throw new Error("it is cut off");
  const [scale, offset] = [131, 155].map((at) => [0, 8, 16].map((next) => view.getFloat64(at + next, true)));
  const points = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      points[3 * i + axis] = view.getInt32(first + i * length + 4 * axis, true) * scale![axis]! + offset![axis]!;
    }
  }
  return points;
}

export function laz(): never {
  throw new Error("the browser cannot read compressed points. Use `firstfix localize`, or save it as .las");
}
