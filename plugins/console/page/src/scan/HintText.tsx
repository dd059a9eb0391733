import type { Schemas } from "../api/client";

/** The move that should tell the places apart: the arrow in the picture shows it from the place that is chosen. */
export function HintText({ hint }: { hint: Schemas["Hint"] }) {
  const way = hint.distance_m > 0 ? `drive ${hint.distance_m.toFixed(1)} m along the blue arrow` : "stay there";
  const side = hint.turn_deg > 0 ? "left" : "right";
  const turn = Math.abs(hint.turn_deg) >= 1 ? `, turn ${Math.abs(hint.turn_deg).toFixed(0)}° to the ${side}` : "";
  return (
    <p class="next" role="note">
      To be sure, {way}
      {turn}, and ask again with both scans. It should tell {hint.tells_apart.length} of the places apart.
    </p>
  );
}
