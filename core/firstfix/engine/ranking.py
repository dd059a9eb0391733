"""Ranking: how strongly a pose is supported, and the features by which its probability is computed.

All numbers by which registered poses are compared and judged are in ``RankingConfig``, in four parts. They
are stored with the version: a calibration is asked with what it was fitted on. Which candidates are
registered at all is the work of the search (``candidates``, ``map_search``). The kernels' own distances are
part of their formulas: who changes one changes the manifest's format.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, nextafter

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from .. import native
from ..answer.quality import AlignmentQuality
from ..errors import REBUILD, IncompatibleVersion


class _Numbers(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SupportConfig(_Numbers):
    """Weights of a pose's support.

    Those of the logarithms are the ones that most often tell the true place from its rivals in ``firstfix-lab
    calibration`` (docs/method.md section 7), on a scale on which 0.01 of a good alignment score is about 0.01
    of support.
    """

    alignment_weight: float = 0.25
    removed_weight: float = 0.04
    violation_weight: float = 0.06
    seen_free_weight: float = 0.07  # of the share in seen-free space: 0 where the map does not know it
    seen_free_offset: float = 0.05  # share; lets people and parked things pass
    best_score: float = 1.05  # keeps the logarithm of a perfect alignment score finite
    # Share that keeps the others finite. With 0.0003, one direction of 2,500 moved the support by 0.05: as
    # much as parts two places.
    least_share: float = 0.001

    def support(self, quality: AlignmentQuality) -> float:
        """Score by which poses are ranked (equation 7.1). Only differences of it mean something.

        Logarithms of the misfit spread good values: from 98 to 99 % is as far as from 80 to 90 %.
        """
        return native.support(self, quality)

    def contradiction(self, quality: AlignmentQuality) -> float:
        """The support that is lost where the scan does not show what the map has, or saw free."""
        return native.contradiction(self, quality)


class ProbabilityConfig(SupportConfig):
    """Numbers from which the probability of a pose is computed, beside the version's calibration."""

    worst_score: float = 0.02  # these four keep the logarithms of perfect values finite
    violation_offset: float = 0.005  # share
    beside_offset: float = 0.02  # share
    same_plane_offset: float = 0.02  # share
    max_margin: float = 0.25  # of support; a larger one counts as this: two in three right places have more
    unlikely_m_s: float = 3.0  # m/s; at this speed a motion is half as likely as rest: a wrong place often
    unlikely_rad_s: float = 4.0  # rad/s; needs one that no robot has there
    motion_score_weight: float = 2.5  # of the logarithm of the score's misfit in the log odds, alone
    likely: float = 0.5  # probability from which one of the places that tie is more likely right than not
    convincing_inlier_ratio: float = 0.75  # below it other up directions are tried, however probable the fix
    promising: float = 0.02  # probability before fine alignment, which raises the inlier ratio a little
    # Model of "the best of those that were not registered is right" (docs/method.md equation 10.1), fitted
    # over ten worlds; a fifth of the scans are of other worlds. In a world that it was not fitted to, it is
    # off by 0.03 on average.
    unregistered_bias: float = -7.84
    unregistered_score: float = 10.07
    unregistered_lead: float = 52.1

    def discounted_score(self, alignment_score: float, twist: NDArray[np.float64] | None) -> float:
        """The alignment score that counts as much as this one and the likelihood of its motion together.

        Three unknowns more let a scan fit wrong places better, but with motions that are unlikely. The
        logarithm of the score's misfit has a known weight in the log odds of a pose, and so has that of the
        motion.

        Args:
            alignment_score: 0..1.
            twist: (6,) m/s then rad/s; None: the scan was aligned rigidly.
        """
        return native.discounted_score(self, alignment_score, twist)

    def match_features(
        self,
        qualities: Sequence[AlignmentQuality],
        tied_within: float,
        number: int = 0,
        supports: Sequence[float] | None = None,
        aliases: Collection[int] = (),
        aliases_tied_within: float = inf,
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
        margin, tied = native.margin_and_tied(supports, number, tied_within, self.max_margin)
        return MatchFeatures(qualities[number], margin, tied, self)


class CandidatesConfig(_Numbers):
    """Numbers by which candidates are compared and chosen."""

    spots_apart_m: float = 0.9  # nearer to each other, scans show the same surfaces again
    same_pose_m: float = 1.0  # nearer poses are one
    same_pose_deg: float = 15.0
    same_start_m: float = 0.3  # nearer starts end at one pose
    same_start_deg: float = 3.0
    rival_within: float = 0.3  # of the best candidate's support: such rivals are compared and aligned too
    max_refined: int = 3  # candidates that are aligned finely, at most
    neighbour_m: float = 0.3  # to the minima beside the right one: the next panel, a wall's other face
    slid_m: float = 0.25  # from the floor: where walls alone are seen, a scan slides up or down along them
    better_by: float = 0.02  # of alignment_score: a scan in motion has several minima nearly as good
    maybe_better_by: float = 0.01  # the same, measured with few points
    same_place_m: float = 3.0  # of candidates that were not registered: nearer ones are one place
    same_place_deg: float = 30.0


class AlignmentConfig(_Numbers):
    """Numbers of the alignments, and of the points that they take.

    The smaller an angle, the more minima there are side by side.
    """

    screen_points: int = 100
    screen_iterations: int = 2
    coarse_points: int = 200
    smooth_iterations: int = 6
    coarse_angle: float = 0.2  # sine between normals at which a pair counts half
    align_angle: float = 0.06
    smooth_angle: float = 0.5
    fine_angle: float = 0.2
    # Scale of the twist about 0 (a Cauchy distribution), linear (m/s) then angular (rad/s), along the level
    # axes. A robot drives and turns on its floor: the other axes are fixed, so that noise does not look like
    # motion.
    twist_scale: tuple[float, float, float, float, float, float] = (1.0, 1.0, 1e-6, 1e-6, 1e-6, 1.0)
    voxelled_points: int = 40_000  # of a scan, to take one a voxel from
    view_points: int = 20_000  # for the free-space check
    dense_points: int = 4000  # for fine alignment
    sparse_points: int = 400  # for the alignment of many candidates


class RankingConfig(ProbabilityConfig, CandidatesConfig, AlignmentConfig):
    """All of these numbers, in one object as a version stores them. A version has all, or needs a rebuild."""

    @classmethod
    def from_stored(cls, stored: object) -> RankingConfig:
        """Read the numbers of a version.

        Raises:
            IncompatibleVersion: this release ranks by other numbers than the version has.
            ValueError: it is not an object of numbers.
        """
        if not isinstance(stored, Mapping):
            raise ValueError("the version has no numbers of its ranking")
        if different := set(stored) ^ set(cls.model_fields):
            raise IncompatibleVersion(
                f"the version was made for another ranking ({', '.join(sorted(different))}): {REBUILD}"
            )
        return cls.model_validate(stored)


RANKING = RankingConfig()  # of versions that are made now


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
    ranking: ProbabilityConfig = RANKING

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
    def inputs(self) -> tuple[float, float, float, float, float]:
        """The numbers of ``vector``."""
        return native.match_inputs(self.ranking, self.quality, self.margin)
