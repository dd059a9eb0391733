"""From what was measured at the places found to the probability that the true one is among the best.

The build's self-test fits it. Places that tie count as one: two equal storeys of a map make every answer
there ambiguous, and no answer less likely to hold the truth (docs/method.md section 7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from ..answer.quality import AlignmentQuality, MatchFeatures, match_features

# One standard deviation that a map's weights may differ from the prior's: a share of each, and of this bias.
SPREAD, SPREAD_BIAS = 0.4, 4.0


@dataclass(frozen=True)
class Calibration:
    """A logistic model over the features of ``MatchFeatures``, and the thresholds of the verdict.

    Attributes:
        bias: of the model.
        alignment_score, free_space, margin: its weights, never negative, so that more evidence never
            makes an answer less likely.
        min_probability: below it an answer is not ``localized``, unless the query says otherwise.
        min_inlier_ratio: below it a place does not explain the scan at all.
        min_margin: places whose support differs by less tie: that is ambiguous however good they are.
        cases: how many self-test cases it was fitted on; 0: it is only the prior, which is the defaults
            below: fitted to eight worlds at once (docs/method.md section 7).
    """

    bias: float = -18.8
    alignment_score: float = 2.94
    free_space: float = 2.74
    margin: float = 21.35
    min_probability: float = 0.99
    min_inlier_ratio: float = 0.4
    min_margin: float = 0.05
    cases: int = 0

    @property
    def weights(self) -> NDArray[np.float64]:
        """(4,) bias first."""
        return np.array([self.bias, self.alignment_score, self.free_space, self.margin])

    def match_features(self, qualities: Sequence[AlignmentQuality], place: int = 0) -> MatchFeatures:
        """Features of one of the compared places; places that tie with it count as one place."""
        return match_features(qualities, self.min_margin, place)

    def probability(self, evidence: MatchFeatures) -> float:
        """0..1 that the place is right, or one of those that tie with it."""
        return float(_logistic(self.weights[0] + evidence.features @ self.weights[1:]))

    def accepts(self, evidence: MatchFeatures, min_probability: float | None = None) -> bool:
        """Whether the best place may be called localized.

        Args:
            min_probability: in place of its own.
        """
        needed = self.min_probability if min_probability is None else min_probability
        explains = evidence.quality.inlier_ratio >= self.min_inlier_ratio
        return explains and evidence.tied == 1 and self.probability(evidence) >= needed

    @classmethod
    def fit(cls, evidence: Sequence[MatchFeatures], right: ArrayLike, weight: ArrayLike) -> Calibration:
        """The most likely after the prior and these cases; no weight is negative.

        Args:
            evidence: (n,) for the best place of each self-test case.
            right: (n,) whether it was right, or one of those that tie with it.
            weight: (n,) how many such cases there would be among real ones.
        """
        truth, counts = np.asarray(right, np.float64), np.asarray(weight, np.float64)
        prior = cls().weights
        spread = SPREAD * np.array([SPREAD_BIAS, *prior[1:]])
        features = np.array([[1.0, *e.features] for e in evidence]).reshape(-1, len(prior))

        def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            log_odds, off = features @ weights, (weights - prior) / spread
            value = counts @ (np.logaddexp(0, log_odds) - truth * log_odds) + off @ off / 2
            gradient = features.T @ (counts * (_logistic(log_odds) - truth)) + off / spread
            return float(value), gradient

        bounds = [(None, None)] + [(0, None)] * (len(prior) - 1)
        found = minimize(loss, prior, jac=True, method="L-BFGS-B", bounds=bounds).x
        bias, alignment_score, free_space, margin = (round(float(v), 4) for v in found)
        return cls(bias, alignment_score, free_space, margin, cases=len(truth))

    def to_mapping(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Calibration:
        """
        Raises:
            ValueError: not the fields of this calibration: another version's.
        """
        if set(data) != {field.name for field in fields(cls)}:
            raise ValueError(f"a calibration has other fields: {sorted(data)}")
        return cls(**data)


def _logistic(x: ArrayLike) -> NDArray[np.float64]:
    return 1 / (1 + np.exp(-np.clip(np.asarray(x, np.float64), -50, 50)))
