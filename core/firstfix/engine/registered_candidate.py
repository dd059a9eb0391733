"""A place where a candidate was registered, how well the scan fits there, and how it compares with others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .. import native
from ..answer.quality import AlignmentQuality
from ..transform import Matrix
from .index import FreeSpaceShares, MapIndex
from .registration.align import Agreement, Registration

NOT_CHECKED = FreeSpaceShares(0.0, 0.0)
NOT_MEASURED = Agreement(0.0, 0.0)


@dataclass(frozen=True)
class RegisteredCandidate:
    """A pose in one map to which a candidate was aligned.

    Attributes:
        index: the map.
        map_id: its id, where several maps compete.
        template: row of the template that the candidate came from.
        registration: the aligned pose, and how well the scan fits there.
        free_space: shares of directions that pass through the map; 0 until free space is checked.
        agreement: how the scan agrees with the map there, beyond how much of it does.
        start_z_m: height, in the level frame, at which the alignment began: the sensor's above the template's
            floor. nan: not known.
        spots: number of spots where the query's scans were taken.
        is_alike: whether the scan does not tell it from the best candidate of its map (``told_apart``).
        outside_lead: support by which a known alias outside the query's prior is better; 0: none is.
    """

    index: MapIndex
    map_id: str
    template: int
    registration: Registration
    free_space: FreeSpaceShares = NOT_CHECKED
    agreement: Agreement = NOT_MEASURED
    start_z_m: float = math.nan
    spots: int = 1
    is_alike: bool = False
    outside_lead: float = 0.0

    @classmethod
    def found(
        cls, index: MapIndex, map_id: str, spots: int, poses: Sequence[tuple[Any, ...]]
    ) -> list[RegisteredCandidate]:
        """The poses of a compiled search.

        Args:
            poses: as ``native.MapSearch.found`` gives them.
        """
        made = []
        for template, start_z_m, T_level_sensor, ratio, score, information, rests, twist, *fit in poses:
            violation, removed, seen_free, beside, same_plane, is_alike, discounted, support = fit
            registration = Registration(T_level_sensor, ratio, score, information, rests, twist)
            free_space, agreement = (
                FreeSpaceShares(violation, removed, seen_free),
                Agreement(beside, same_plane),
            )
            one = cls(
                *(index, map_id, template, registration, free_space, agreement),
                *(start_z_m, spots, is_alike),
            )
            # measured already: the properties below would measure it again
            quality = AlignmentQuality(ratio, discounted, violation, removed, beside, same_plane, seen_free)
            one.__dict__.update(quality=quality, support=support)
            made.append(one)
        return made

    @cached_property  # each of a hundred candidates is compared with all others
    def quality(self) -> AlignmentQuality:
        """Fit of the scan to the map at this pose, less for a motion during the scan that is unlikely."""
        return AlignmentQuality(
            self.registration.inlier_ratio,
            self.index.config.ranking.discounted_score(
                self.registration.alignment_score, self.registration.twist
            ),
            self.free_space.free_space_violation,
            self.free_space.removed_surface,
            **vars(self.agreement),
            seen_free=self.free_space.seen_free,
        )

    @cached_property
    def support(self) -> float:
        """Score by which candidates are ranked."""
        return self.index.config.ranking.support(self.quality)

    @property
    def is_better_outside(self) -> bool:
        """Whether the scan fits a place outside the prior clearly better: the prior is wrong then."""
        return self.outside_lead >= self.index.calibration.alias_margin

    @property
    def T_map_sensor(self) -> Matrix:
        """(4, 4) pose in the map's own frame."""
        return native.pose_product(self.index.T_map_level, self.registration.T_level_sensor)
