/** The scan that is tried, as it is sent. */
export interface Asked {
  name: string;
  type: string;
  encoding: string;
  body: Blob;
  spot?: readonly number[]; // of the map, at which it was simulated; else there is none
}
