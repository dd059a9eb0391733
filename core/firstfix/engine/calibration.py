"""Calibration: the probability that the best pose is right, and the thresholds of the verdict.

The build's self-test fits the calibration. Poses that tie count as one: two equal storeys of a map make every
answer there ambiguous, but no answer less likely to contain the true pose. How likely that is, a model of its
own says (docs/method.md section 7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import native
from ..errors import REBUILD, IncompatibleVersion
from .ranking import MatchFeatures

# Standard deviation of a map's weights around the prior's: SPREAD times the weight, for the bias SPREAD_BIAS.
SPREAD, SPREAD_BIAS = 0.4, 4.0
# Newton's method: steps at most, the part of its promise that a step must keep, and when it rests.
_MOST_STEPS, _ENOUGH, _LEAST_SHARE, _RESTS = 100, 1e-4, 1e-9, 1e-8
# Fields of ``Calibration``, in the order of ``MatchFeatures.vector``.
WEIGHTS = ("bias", "alignment_score", "free_space", "beside_surface", "same_plane", "margin")


@dataclass(frozen=True)
class Calibration:
    """Logistic model over ``MatchFeatures.vector``, and the thresholds of the verdict.

    The defaults are the prior, fitted to nine maps at once (docs/method.md section 7).

    Attributes:
        bias: of the model.
        alignment_score, free_space, beside_surface, same_plane, margin: its weights. They are never negative:
            a better fit never makes an answer less likely.
        min_probability: below it an answer is not ``localized``, unless the query gives its own threshold.
        search_until: below it the search goes on, though the answer may be ``localized``: it is the threshold
            that the map's own cases show, where many maps have taught a lower one. What is searched for less
            is less often right.
        min_inlier_ratio: below it a pose does not explain the scan at all.
        max_free_space_violation: nor does a pose that more of the scan's directions contradict.
        min_margin: poses tie if their support differs by less: the answer is then ambiguous, however good
            they are.
        alias_margin: the same for the best pose and its known aliases; ``min_margin`` or more.
        cases: number of self-test cases it was fitted on; 0: it is the prior.
        among_tied: weights of the model for poses that tie, bias first; empty: they are the others.
        with_prior: calibration of queries with a prior, for which only what lies in it competes (see
            ``with_prior.judging``); None: they are judged as the others.
    """

    bias: float = -20.1
    alignment_score: float = 1.45
    free_space: float = 1.74
    beside_surface: float = 2.5
    same_plane: float = 1.66
    margin: float = 21.1
    min_probability: float = 0.995
    min_inlier_ratio: float = 0.4
    max_free_space_violation: float = 0.1
    min_margin: float = 0.05
    cases: int = 0
    among_tied: tuple[float, ...] = ()
    alias_margin: float = 0.05
    search_until: float = 0.995
    with_prior: Calibration | None = None

    @property
    def weights(self) -> NDArray[np.float64]:
        """(6,) weights of the model, bias first."""
        return np.array([getattr(self, name) for name in WEIGHTS])

    def with_ties_as_in(self, other: Calibration) -> Calibration:
        """This calibration, with the other one's weights for poses that tie."""
        return replace(self, among_tied=tuple(other.weights.tolist()))

    def probability(self, features: MatchFeatures) -> float:
        """Probability, 0..1, that the pose or one that ties with it is right."""
        asked = features.ranking, features.quality, features.margin, features.tied
        return native.probability(self, *asked)

    def accepts(self, features: MatchFeatures, min_probability: float | None = None) -> bool:
        """Whether the verdict may be ``localized``.

        Args:
            min_probability: threshold to use instead of the calibration's own.
        """
        needed = self.min_probability if min_probability is None else min_probability
        asked = features.ranking, features.quality, features.margin, features.tied
        return native.accepts(self, *asked, needed)

    def ends_search(self, features: MatchFeatures) -> bool:
        """Whether a pose is so surely right that nothing else is searched for."""
        return self.accepts(features, self.search_until)

    @classmethod
    def fit(cls, features: Sequence[MatchFeatures], right: ArrayLike, weight: ArrayLike) -> Calibration:
        """Fit the most likely calibration, given the prior and self-test cases. No weight is negative.

        Args:
            features: (n,) of the best pose of each case.
            right: (n,) whether that pose, or one that ties with it, was right.
            weight: (n,) number of real cases that each stands for.
        """
        truth, counts = np.asarray(right, np.float64), np.asarray(weight, np.float64)
        inputs = np.array([[1.0, *one.vector] for one in features]).reshape(-1, len(WEIGHTS))
        found = _most_likely(inputs, truth, counts, cls().weights)
        rounded: dict[str, Any] = {
            name: round(float(value), 4) for name, value in zip(WEIGHTS, found, strict=True)
        }
        return cls(**rounded, cases=len(truth))

    def to_mapping(self) -> dict[str, Any]:
        """Values by name, ready for JSON; ``with_prior`` only if there is one."""
        values = asdict(self)
        if self.with_prior is None:
            del values["with_prior"]
        else:
            values["with_prior"] = self.with_prior.to_mapping()
        return values

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Calibration:
        """Read what ``to_mapping`` returned.

        Raises:
            IncompatibleVersion: it was fitted on other features.
            ValueError: a field is none.
        """
        values = {"with_prior": None, **data}
        different = set(values) ^ {field.name for field in fields(cls)}
        if different:
            raise IncompatibleVersion(
                f"the version was calibrated for another ranking ({', '.join(sorted(different))}): {REBUILD}"
            )
        among_tied = tuple(map(float, values["among_tied"]))
        if among_tied and len(among_tied) != len(WEIGHTS):
            raise ValueError(f"fields of a calibration: {len(among_tied)} weights for poses that tie")
        taught = values["with_prior"]
        with_prior = None if taught is None else cls.from_mapping(taught)
        return cls(**{**values, "among_tied": among_tied, "with_prior": with_prior})


def _most_likely(
    inputs: NDArray[np.float64],
    truth: NDArray[np.float64],
    counts: NDArray[np.float64],
    prior: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Weights (k,) of the largest posterior, none but the first negative: Newton's method, projected.

    Args:
        inputs: (n, k) of the cases, the first column 1.
        truth, counts: (n,) 0 or 1, and the number of cases that each stands for.
        prior: (k,) weights, the mean of a normal distribution.
    """
    spread = SPREAD * np.array([SPREAD_BIAS, *prior[1:]])
    bounded = np.arange(len(prior)) > 0

    def loss(weights: NDArray[np.float64]) -> float:
        log_odds, off = inputs @ weights, (weights - prior) / spread
        return float(counts @ (np.logaddexp(0, log_odds) - truth * log_odds) + off @ off / 2)

    weights = prior.copy()
    value = loss(weights)
    for _ in range(_MOST_STEPS):
        chance = _logistic(inputs @ weights)
        gradient = inputs.T @ (counts * (chance - truth)) + (weights - prior) / spread**2
        curvature = (inputs.T * (counts * chance * (1 - chance))) @ inputs + np.diag(spread**-2)
        free = ~(bounded & (weights <= 0) & (gradient > 0))
        step = np.zeros_like(weights)
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], gradient[free])
        share = 1.0
        while True:
            reached = np.where(bounded, np.maximum(weights + share * step, 0), weights + share * step)
            there = loss(reached)
            if there <= value + _ENOUGH * gradient @ (reached - weights) or share < _LEAST_SHARE:
                break
            share /= 2
        moved = float(np.abs(reached - weights).max())
        if there < value:
            weights, value = reached, there
        if moved < _RESTS:
            break
    return weights


def _logistic(x: ArrayLike) -> NDArray[np.float64]:
    return 1 / (1 + np.exp(-np.clip(np.asarray(x, np.float64), -50, 50)))
