"""Ranking: how strongly a pose is supported, and the features by which its probability is computed.

All numbers by which registered poses are compared and judged are in ``RankingConfig``, which is stored with
the version: a calibration is asked with what it was fitted on. Which candidates are registered at all is the
work of the search (``candidates``, ``map_search``). The kernels' own distances are part of their formulas:
who changes one changes the manifest's format.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, log, nextafter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from ..answer.quality import AlignmentQuality
from ..errors import REBUILD, IncompatibleVersion


class RankingConfig(BaseModel):
    """Numbers that ranking and calibration read. None has a default: a version has all, or needs a rebuild.

    Attributes:
        alignment_weight, removed_weight, violation_weight: of the logarithms in a pose's support: those that
            most often tell the true place from its rivals in ``firstfix-lab calibration``
            (docs/method.md section 7), on a scale on which 0.01 of a good alignment score is about 0.01 of
            support.
        seen_free_weight, seen_free_offset: the same of the share in seen-free space, which is 0 where the map
            does not know it. The offset lets people and parked things pass.
        best_score, least_share: keep the logarithms of perfect values finite.
        worst_score, violation_offset, beside_offset, same_plane_offset: for the probability.
        max_margin: a larger margin counts as this. About two in three right places have more.
        unlikely_m_s, unlikely_rad_s: speeds at which a motion is half as likely as rest. A wrong place often
            needs one that no robot has there.
        motion_score_weight: of the logarithm of the score's misfit in the log odds, if it counts alone.
        twist_scale: (6,) scale of the twist about 0 (a Cauchy distribution), linear then angular, along the
            level axes. A robot drives and turns on its floor: the other axes are fixed, so that noise does
            not look like motion.
        likely: from this probability on, one of the places that tie is more likely right than not.
        convincing_inlier_ratio: below it other up directions are tried too, however probable the fix is.
        spots_apart_m: nearer to each other, scans show the same surfaces again.
        same_pose_m, same_pose_deg: nearer poses are one.
        same_start_m, same_start_deg: nearer starts end at one pose.
        rival_within: of the best candidate's support: such rivals are compared and aligned as it is.
        max_refined: candidates that are aligned finely, at most.
        neighbour_m: to the minima beside the right one: the next panel, a wall's other face.
        slid_m: from the floor: where walls alone are seen, a scan slides up or down along them.
        better_by: of alignment_score: a scan distorted by motion has several minima nearly as good.
        maybe_better_by: the same, measured with few points.
        promising: probability before fine alignment, which raises the inlier ratio a little.
        screen_points, screen_iterations, coarse_points, smooth_iterations: of the alignments so named.
        coarse_angle, align_angle, smooth_angle, fine_angle: sine between normals at which a pair counts half.
            The smaller, the more minima there are side by side.
        voxelled_points, view_points, dense_points, sparse_points: of a scan, to take one a voxel from, and
            for the free-space check, fine alignment, and the alignment of many candidates.
        same_place_m, same_place_deg: of candidates that were not registered: nearer ones are one place.
        unregistered_bias, unregistered_score, unregistered_lead: model of "the best of them is
            right" (docs/method.md equation 10.1), fitted over ten worlds; a fifth of the scans are of other
            worlds. In a world that it was not fitted to, it is off by 0.03 on average.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    alignment_weight: float
    removed_weight: float
    violation_weight: float
    seen_free_weight: float
    seen_free_offset: float
    best_score: float
    least_share: float
    worst_score: float
    violation_offset: float
    beside_offset: float
    same_plane_offset: float
    max_margin: float
    unlikely_m_s: float
    unlikely_rad_s: float
    motion_score_weight: float
    twist_scale: tuple[float, float, float, float, float, float]
    likely: float
    convincing_inlier_ratio: float
    spots_apart_m: float
    same_pose_m: float
    same_pose_deg: float
    same_start_m: float
    same_start_deg: float
    rival_within: float
    max_refined: int
    neighbour_m: float
    slid_m: float
    better_by: float
    maybe_better_by: float
    promising: float
    screen_points: int
    screen_iterations: int
    coarse_points: int
    smooth_iterations: int
    coarse_angle: float
    align_angle: float
    smooth_angle: float
    fine_angle: float
    voxelled_points: int
    view_points: int
    dense_points: int
    sparse_points: int
    same_place_m: float
    same_place_deg: float
    unregistered_bias: float
    unregistered_score: float
    unregistered_lead: float

    def support(self, quality: AlignmentQuality) -> float:
        """Score by which poses are ranked (equation 7.1). Only differences of it mean something.

        Logarithms of the misfit spread good values: from 98 to 99 % is as far as from 80 to 90 %.
        """
        seen_free = quality.seen_free or 0.0
        return -(
            self.alignment_weight * log(self.best_score - quality.alignment_score)
            + self.removed_weight * log(self.least_share + quality.removed_surface)
            + self.violation_weight * log(self.least_share + quality.free_space_violation)
            + self.seen_free_weight * log(1 + seen_free / self.seen_free_offset)
        )

    def discounted_score(self, alignment_score: float, twist: NDArray[np.float64] | None) -> float:
        """The alignment score that counts as much as this one and the likelihood of its motion together.

        Three unknowns more let a scan fit wrong places better, but with motions that are unlikely. The
        logarithm of the score's misfit has a known weight in the log odds of a pose, and so has that of the
        motion.

        Args:
            alignment_score: 0..1.
            twist: (6,) m/s then rad/s; None: the scan was aligned rigidly.
        """
        if twist is None:
            return alignment_score
        linear, angular = twist[:3] / self.unlikely_m_s, twist[3:] / self.unlikely_rad_s
        odds = float((1 + linear @ linear) * (1 + angular @ angular))
        misfit = (self.best_score - alignment_score) * odds ** (1 / self.motion_score_weight)
        return max(self.best_score - misfit, 0.0)

    def match_features(
        self,
        qualities: Sequence[AlignmentQuality],
        tied_within: float,
        number: int = 0,
        supports: Sequence[float] | None = None,
        aliases: Collection[int] = (),
        aliases_tied_within: float = 0.0,
    ) -> MatchFeatures:
        """Match features of one pose, given the qualities of all poses that compete.

        If several poses compete and all of them tie, the best rival was not compared. Then the margin is what
        is known of it: the lead of the pose over the weakest one.

        Args:
            tied_within: poses tie if their support differs by less.
            number: of the pose.
            supports: of all poses, where they are known already.
            aliases: numbers of the poses that are known aliases of this one.
            aliases_tied_within: these tie if their support differs by less, and so do all poses that the scan
                fits better than one of these.
        """
        if supports is None:
            supports = [self.support(quality) for quality in qualities]
        own = supports[number]
        apart = [abs(supports[alias] - own) for alias in aliases]
        furthest = max((by for by in apart if by < aliases_tied_within), default=0.0)
        tied_within = max(tied_within, nextafter(furthest, inf))
        rivals = [support for support in supports if abs(support - own) >= tied_within]
        margin = self.max_margin if len(supports) == 1 else own - (max(rivals) if rivals else min(supports))
        return MatchFeatures(qualities[number], margin, len(supports) - len(rivals), self)

    @classmethod
    def from_stored(cls, stored: Mapping[str, Any] | None) -> RankingConfig:
        """Reads the numbers of a version; None: of one from before they were stored.

        Raises:
            IncompatibleVersion: this release ranks by other numbers than the version has.
            ValueError: a number is none.
        """
        numbers = _LATER | (_UNSTORED if stored is None else dict(stored))
        different = set(numbers) ^ set(cls.model_fields)
        if different:
            raise IncompatibleVersion(
                f"the version was made for another ranking ({', '.join(sorted(different))}): {REBUILD}"
            )
        return cls.model_validate(numbers)


# Versions from before the numbers were stored were made with these. They never change: what a newer release
# changes or adds stands in ``RANKING`` alone.
_UNSTORED: dict[str, Any] = {
    "alignment_weight": 0.25,
    "removed_weight": 0.04,
    "violation_weight": 0.06,
    "best_score": 1.05,
    "least_share": 0.0003,
    "worst_score": 0.02,
    "violation_offset": 0.005,
    "beside_offset": 0.02,
    "same_plane_offset": 0.02,
    "max_margin": 0.25,
    "unlikely_m_s": 3.0,
    "unlikely_rad_s": 4.0,
    "motion_score_weight": 2.5,
    "twist_scale": (1.0, 1.0, 1e-6, 1e-6, 1e-6, 1.0),
    "likely": 0.5,
    "convincing_inlier_ratio": 0.75,
    "spots_apart_m": 0.9,
    "same_pose_m": 1.0,
    "same_pose_deg": 15.0,
    "same_start_m": 0.3,
    "same_start_deg": 3.0,
    "rival_within": 0.3,
    "max_refined": 3,
    "neighbour_m": 0.3,
    "slid_m": 0.25,
    "better_by": 0.02,
    "maybe_better_by": 0.01,
    "promising": 0.02,
    "screen_points": 100,
    "screen_iterations": 2,
    "coarse_points": 200,
    "smooth_iterations": 6,
    "coarse_angle": 0.2,
    "align_angle": 0.06,
    "smooth_angle": 0.5,
    "fine_angle": 0.2,
    "voxelled_points": 40_000,
    "view_points": 20_000,
    "dense_points": 4000,
    "sparse_points": 400,
    "same_place_m": 3.0,
    "same_place_deg": 30.0,
    "unregistered_bias": -7.84,
    "unregistered_score": 10.07,
    "unregistered_lead": 52.1,
}
# Numbers that came later, and change nothing in a version without them: it has no file that they are about.
_LATER: dict[str, Any] = {"seen_free_weight": 0.07, "seen_free_offset": 0.05}
# With 0.0003, one direction of 2,500 moved the support by 0.05: as much as parts two places.
_CHANGED: dict[str, Any] = {"least_share": 0.001}
RANKING = RankingConfig.model_validate(_UNSTORED | _LATER | _CHANGED)  # of versions that are made now


@dataclass(frozen=True)
class MatchFeatures:
    """Features of one pose among those that compete, from which its probability is computed.

    If other poses tie with it, they are features of "one of these poses is right".

    Attributes:
        quality: of the pose.
        margin: by how much its support exceeds that of the best pose that does not tie with it.
        tied: number of poses that tie, this one included: no margin tells them apart.
        ranking: the numbers of the map.
    """

    quality: AlignmentQuality
    margin: float
    tied: int = 1
    ranking: RankingConfig = RANKING

    @property
    def without_rivals(self) -> MatchFeatures:
        """The features that the pose would have alone."""
        return replace(self, margin=self.ranking.max_margin, tied=1)

    @property
    def vector(self) -> NDArray[np.float64]:
        """(5,) inputs of the logistic model (equation 7.2). A larger value never lowers the probability.

        A removed surface does not count here, but in the margin: things leave, wherever the scan was taken.
        """
        return np.array(self.inputs)

    @property
    def inputs(self) -> tuple[float, ...]:
        """The numbers of ``vector``."""
        ranking, quality = self.ranking, self.quality
        score = quality.alignment_score
        return (
            log((ranking.worst_score + score) / (ranking.best_score - score)),
            -log(ranking.violation_offset + quality.free_space_violation),
            -log(ranking.beside_offset + quality.beside_surface),
            -log(ranking.same_plane_offset + quality.same_plane),
            min(self.margin, ranking.max_margin),
        )
