"""From what registration measured to the probability of being right, fitted by the build's self-test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Calibration:
    """A logistic model over (overlap, margin), and the thresholds of the verdict.

    Margin is the overlap of the best hypothesis less that of the best one at another place.

    Attributes:
        bias, overlap, margin: the model's weights; overlap and margin are never negative, so that
            more evidence never makes an answer less likely.
        min_probability: below it an answer is not ``localized``, unless the query says otherwise.
        min_overlap: below it a place does not explain the scan at all.
        min_margin: with less, two places explain it: that is ambiguous however good the better one is.
        cases: how many self-test queries it was fitted on; 0: it is only the prior below.
    """

    bias: float = -12.0
    overlap: float = 18.0
    margin: float = 8.0
    min_probability: float = 0.9
    min_overlap: float = 0.4
    min_margin: float = 0.15
    cases: int = 0

    def probability(self, overlap: float, margin: float) -> float:
        """0..1 that the best hypothesis is right."""
        return float(_logistic(self.bias + self.overlap * overlap + self.margin * margin))

    @classmethod
    def fit(cls, overlap: ArrayLike, margin: ArrayLike, right: ArrayLike) -> Calibration:
        """Ridge-regularised maximum likelihood, pulled towards the defaults (Newton's method).

        Args:
            overlap, margin: (n,) of the best hypothesis of each self-test query.
            right: (n,) whether it was right.
        """
        prior = np.array([cls.bias, cls.overlap, cls.margin])
        features = np.column_stack([np.ones(np.size(overlap)), overlap, margin]).astype(np.float64)
        truth = np.asarray(right, np.float64)
        if len(truth) == 0:
            return cls()
        strength = np.diag([0.002, 0.002, 0.002])
        weights = prior.copy()
        for _ in range(50):
            p = _logistic(features @ weights)
            gradient = features.T @ (p - truth) + strength @ (weights - prior)
            hessian = (features * (p * (1 - p))[:, None]).T @ features + strength
            step = np.linalg.solve(hessian, gradient)
            step *= min(1.0, 5.0 / max(float(np.abs(step).max()), 1e-12))  # no leap where it is flat
            weights = weights - step
            if np.abs(step).max() < 1e-6:
                break
        bias, w_overlap, w_margin = (round(float(v), 4) for v in weights)
        return cls(bias, max(w_overlap, 0.0), max(w_margin, 0.0), cases=len(truth))

    def to_mapping(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Calibration:
        return cls(**data)


def _logistic(x: ArrayLike) -> NDArray[np.float64]:
    return 1 / (1 + np.exp(-np.clip(np.asarray(x, np.float64), -50, 50)))
