/** Points, (x, y, z) one after the other, metres in the sensor's frame. */
export type Points = Float32Array<ArrayBuffer>;
