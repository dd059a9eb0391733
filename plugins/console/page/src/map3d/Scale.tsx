// The scale bar and the axes of the map, in the corner of the picture.

import { barOf, type Orientation } from "./orientation";

const MAX_PX = 110;
const AXES = ["x", "y", "z"];
const REACH = 17; // of an axis that lies in the picture, pixels

export function Scale({ orientation }: { orientation: Orientation }) {
  const { m, px } = barOf(orientation.metresPerPixel, MAX_PX);
  return (
    <div class="scale">
      <svg class="axes" viewBox="-26 -26 52 52" role="img" aria-label="Axes of the map: x, y (north) and z (up)">
        {orientation.axes.map(([right, up], axis) => (
          <g class={`axis ${AXES[axis]}`} key={AXES[axis]}>
            <line x2={REACH * right} y2={-REACH * up} />
            {Math.hypot(right, up) > 0.25 ? (
              <text x={1.4 * REACH * right} y={-1.4 * REACH * up}>
                {AXES[axis]}
              </text>
            ) : null}
          </g>
        ))}
      </svg>
      <svg class="bar-of-scale" width={px + 2} height="8" role="img" aria-label={`This bar is ${lengthOf(m)} long`}>
        <path d={`M1 1v6h${px}v-6`} />
      </svg>
      <span>{lengthOf(m)}</span>
    </div>
  );
}

function lengthOf(m: number): string {
  return m >= 1000 ? `${m / 1000} km` : m >= 1 ? `${m} m` : `${Math.round(m * 100)} cm`;
}
