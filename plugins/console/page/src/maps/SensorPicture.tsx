// The rays of a sensor from the side: where it looks, and how far.

import type { Schemas } from "../api/client";

const REACH = 140; // pixels

export function SensorPicture({ sensor }: { sensor: Schemas["Sensor"] }) {
  const elevations = [...sensor.elevations_deg].sort((a, b) => a - b);
  const text = `${elevations.length} beams from ${elevations[0]} to ${elevations.at(-1)} degrees, up to ${sensor.max_range_m} m`;
  return (
    <figure class="sensor">
      <svg viewBox={`0 -${REACH} ${2 * REACH} ${2 * REACH}`} role="img" aria-label={text}>
        {elevations.map((degrees, i) => {
          const [dx, dy] = [Math.cos((degrees * Math.PI) / 180), -Math.sin((degrees * Math.PI) / 180)];
          return (
            <g key={i}>
              <line x1={REACH} y1={0} x2={REACH + dx * REACH} y2={dy * REACH} />
              <line x1={REACH} y1={0} x2={REACH - dx * REACH} y2={dy * REACH} />
            </g>
          );
        })}
        <circle cx={REACH} cy={0} r={5} />
      </svg>
      <figcaption>{text}</figcaption>
    </figure>
  );
}
