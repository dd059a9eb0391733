"""Bound on false accepts: how often a map may answer ``localized`` wrongly, by the threshold.

The build's self-test counts the accepted among its negatives: scans whose place is not in the map, or was
not found (docs/method.md section 11).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidOption

FILE_NAME = "false_accept_bound.json"
CONFIDENCE = 0.95
# Fixed beforehand, and tried from the last one down: a threshold that is chosen so keeps the confidence.
THRESHOLDS = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995)


@dataclass(frozen=True)
class Row:
    """One threshold.

    Attributes:
        min_probability: the threshold.
        accepted: number of the negatives that it accepts.
        bound: 0..1, with 95 % confidence no larger share of such scans is accepted.
    """

    min_probability: float
    accepted: int
    bound: float


@dataclass(frozen=True)
class FalseAcceptBound:
    """Bounds on false accepts of one map version.

    Attributes:
        negatives: number of the self-test's scans whose place is not in the map, or was not found.
        rows: one for each of THRESHOLDS, in ascending order; none: nothing was measured.
    """

    negatives: int = 0
    rows: tuple[Row, ...] = ()

    @classmethod
    def of(cls, probabilities: ArrayLike) -> FalseAcceptBound:
        """The bounds that negatives show.

        Args:
            probabilities: (n,) of each negative, from a calibration that was not fitted on it; -1 where no
                threshold would accept it.
        """
        claimed = np.asarray(probabilities, np.float64)
        counts = [int((claimed >= threshold).sum()) for threshold in THRESHOLDS]
        return cls(
            len(claimed),
            tuple(
                Row(threshold, count, upper_bound(count, len(claimed)))
                for threshold, count in zip(THRESHOLDS, counts, strict=True)
            ),
        )

    @property
    def least(self) -> float:
        """The least bound that a threshold has; 1 if nothing was measured."""
        return min((row.bound for row in self.rows), default=1.0)

    def min_probability(self, max_false_accept: float, map_id: str = "") -> float:
        """The lowest threshold whose bound is at most ``max_false_accept``.

        Raises:
            InvalidOption: no threshold has such a bound.
        """
        for row in self.rows:
            if row.bound <= max_false_accept:
                return row.min_probability
        of_map = f"map {map_id}" if map_id else "this map"
        raise InvalidOption(
            f"max_false_accept {max_false_accept}: the least bound of {of_map} is {self.least}"
            if self.rows
            else f"max_false_accept {max_false_accept}: no bound was measured for {of_map}, build it again"
        )

    def to_mapping(self) -> dict[str, Any]:
        """Values by name, ready for JSON."""
        rows = [
            {"min_probability": r.min_probability, "accepted": r.accepted, "bound": r.bound}
            for r in self.rows
        ]
        return {"confidence": CONFIDENCE, "negatives": self.negatives, "rows": rows}

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> FalseAcceptBound:
        """Read what ``to_mapping`` returned.

        Raises:
            ValueError, KeyError, TypeError: it is something else, or the rows are out of order.
        """
        rows = tuple(
            Row(float(row["min_probability"]), int(row["accepted"]), float(row["bound"]))
            for row in data["rows"]
        )
        for below, above in pairwise(rows):
            if not (below.min_probability < above.min_probability and below.bound >= above.bound):
                raise ValueError("the rows of a false-accept bound are out of order")
        if not all(0 <= row.min_probability <= 1 and 0 <= row.bound <= 1 for row in rows):
            raise ValueError("a false-accept bound is not within 0 and 1")
        return cls(int(data["negatives"]), rows)

    @classmethod
    def load(cls, directory: Path) -> FalseAcceptBound:
        """Read a version's file. A version without one has no rows."""
        path = directory / FILE_NAME
        return cls.from_mapping(json.loads(path.read_text())) if path.exists() else cls()


def upper_bound(accepted: int, negatives: int, confidence: float = CONFIDENCE) -> float:
    """One-sided upper confidence bound of a share (Clopper and Pearson, 1934), rounded up to six digits."""
    from scipy.special import betaincinv  # imported late: a query reads bounds, and makes none

    if accepted >= negatives:
        return 1.0
    exact = float(betaincinv(accepted + 1, negatives - accepted, confidence))
    return math.ceil(exact * 1e6) / 1e6
