"""Quality of an alignment."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AlignmentQuality:
    """Fit of a scan to the map at one pose.

    Attributes:
        inlier_ratio: 0..1, share of the scan's points within the inlier distance of the map.
        alignment_score: 0..1, the same, but a point counts less the further it lies from the map.
        free_space_violation: 0..1, share of the scan's directions that pass through a surface of the map and
            end where the map has nothing.
        removed_surface: 0..1, share of the scan's directions that pass through a surface of the map and end
            at another one: something may have left.
        beside_surface: 0..1, share of the scan's points that lie near a surface of the map, but on none. It
            speaks against a place more than points where the map has nothing, which a mapping run may have
            missed.
        same_plane: 0..1, chance that two of the scan's upright points that lie on the map lie on one plane.
            It is small where many surfaces agree, and large in a bare room, which has its like elsewhere.
            An answer that was sent has neither this nor ``beside_surface``: they are 0.
        seen_free: 0..1, share of the scan's points that lie in space that the mapping run saw free. What
            stands there came later, or the place is another one. None: the map does not know, because it has
            no trajectory.
    """

    inlier_ratio: float
    alignment_score: float
    free_space_violation: float
    removed_surface: float = 0.0
    beside_surface: float = 0.0
    same_plane: float = 0.0
    seen_free: float | None = None
