/** What the colours of the heat layer mean: the share of the self-test's scans that were localized there. */
export function HeatLegend({ hasCrosses }: { hasCrosses: boolean }) {
  return (
    <figure class="legend-of-heat" role="group" aria-label="Colours of the places">
      <figcaption>Scans of the self-test that were localized there</figcaption>
      <div class="heat" />
      <div class="ends">
        <span>none</span>
        <span>half</span>
        <span>all</span>
      </div>
      {hasCrosses ? <p class="hint">Crossed: mapped in part, from a door or from afar</p> : null}
    </figure>
  );
}
