import type { OverlayShares } from "./overlay";

/** What the colours of the scan mean, and how many points have each. */
export function ScanKey({ shares }: { shares: OverlayShares }) {
  return (
    <ul class="key" aria-label="Points of the scan">
      <li class="agrees">on the map: {shares.agrees} points</li>
      <li class="contradicts">through the map: {shares.contradicts}</li>
      <li class="unexplained">not in the map: {shares.unexplained}</li>
    </ul>
  );
}
