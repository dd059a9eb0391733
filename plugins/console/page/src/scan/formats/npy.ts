// NumPy's .npy: an array (n, 3 or more) of floating-point numbers.

import type { Points } from "./points";

const MAGIC = "\x93NUMPY";

export function npy(body: ArrayBuffer): Points {
  const view = new DataView(body);
  const bytes = new Uint8Array(body);
  if (body.byteLength < 12 || String.fromCharCode(...bytes.subarray(0, 6)) !== MAGIC) {
    throw new Error("it is no .npy file: it does not begin as one");
  }
  const isLong = bytes[6]! > 1;
  const start = isLong ? 12 : 10;
  const length = isLong ? view.getUint32(8, true) : view.getUint16(8, true);
  const header = new TextDecoder("latin1").decode(bytes.subarray(start, start + length));
  const kind = /'descr':\s*'([<>|=])f([48])'/.exec(header);
  const shape = /'shape':\s*\(([^)]*)\)/.exec(header)?.[1]!.split(",").filter((word) => word.trim()).map(Number);
  if (!kind || !shape) throw new Error("its numbers are not float32 or float64");
  const [rows, columns] = shape;
  if (shape.length !== 2 || columns! < 3) throw new Error(`its array has the shape (${shape.join(", ")}): scans are (n, 3)`);
  if (rows === 3 && columns! > 8) throw new Error(`its array has the shape (3, ${columns}): scans are (n, 3), so transpose it`);
  const size = Number(kind[2]);
  const data = start + length;
  if (body.byteLength < data + rows! * columns! * size) throw new Error("it is cut off");
  const isByColumns = header.includes("'fortran_order': True");
  const isLittle = kind[1] !== ">";
  const read = size === 8 ? view.getFloat64.bind(view) : view.getFloat32.bind(view);
  const points = new Float32Array(3 * rows!);
  for (let row = 0; row < rows!; row++) {
    for (let axis = 0; axis < 3; axis++) {
      const number = isByColumns ? axis * rows! + row : row * columns! + axis;
      points[3 * row + axis] = read(data + number * size, isLittle);
    }
  }
  return points;
}
