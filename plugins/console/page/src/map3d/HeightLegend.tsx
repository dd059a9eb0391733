/** What the colours of the points mean. */
export function HeightLegend({ high }: { high: number }) {
  return (
    <figure class="legend-of-heights" role="group" aria-label="Colours of the points">
      <div class="heights" />
      <div class="ends">
        <span>floor</span>
        <span>{high.toFixed(1)} m above it</span>
      </div>
    </figure>
  );
}
