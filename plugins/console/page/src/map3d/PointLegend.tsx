import type { Colouring } from "./material";

export interface PointLegendProps {
  colouring: Colouring;
  high: number; // metres above the floor that the colours reach
  intensity: readonly number[] | null | undefined; // of the darkest and the brightest points
}

/** What the colours of the points mean. */
export function PointLegend({ colouring, high, intensity }: PointLegendProps) {
  if (colouring === "height") return <Legend scale="heights" low="floor" high={`${high.toFixed(1)} m above it`} />;
  if (colouring !== "intensity" || !intensity) return null;
  const [low, most] = intensity.map((value) => String(Number(value.toPrecision(3)))) as [string, string];
  return <Legend scale="intensities" low={low} high={`intensity ${most}`} />;
}

function Legend({ scale, low, high }: { scale: string; low: string; high: string }) {
  return (
    <figure class="legend-of-points" role="group" aria-label="Colours of the points">
      <div class={scale} />
      <div class="ends">
        <span>{low}</span>
        <span>{high}</span>
      </div>
    </figure>
  );
}
