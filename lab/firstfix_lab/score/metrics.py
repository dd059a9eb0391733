"""Metrics of lab/docs/benchmark-protocol.md: pure functions of scored cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .scored import Scored

SUCCESS = ((0.2, 1.0), (1.0, 5.0), (2.0, 5.0))  # metres and degrees
BINS = 10  # of the confidence, equally wide
RISKS = (0.0, 0.01)  # at which the coverage is told
DIGITS = 4


@dataclass(frozen=True)
class RiskCoverage:
    """Risk against coverage, as the system's confidence is asked for less and less.

    Attributes:
        coverage: (k,) share of all cases whose confidence is at least that of the k-th level.
        risk: (k,) share of these whose pose is wrong.
    """

    coverage: NDArray[np.float64]
    risk: NDArray[np.float64]

    @property
    def area(self) -> float:
        """Mean risk over the coverage that is reached: 0 is best."""
        steps = np.diff(self.coverage, prepend=0.0)
        return float((self.risk * steps).sum() / self.coverage[-1])

    def coverage_at(self, most_risk: float) -> float:
        """The largest coverage with no more risk than this."""
        return float(max(self.coverage[self.risk <= most_risk], default=0.0))


@dataclass(frozen=True)
class Bin:
    """Poses of one step of confidence.

    Attributes:
        count: of the poses.
        confidence: mean.
        right: share that is right.
    """

    count: int
    confidence: float
    right: float


def success_rate(cases: Sequence[Scored], limit_m: float, limit_deg: float) -> float | None:
    """The share of the scans of the map that got an accepted pose this close; None: no such scans."""
    inside = [case for case in cases if case.is_inside]
    return _share([case.is_accepted and case.is_within(limit_m, limit_deg) for case in inside])


def risk_coverage(cases: Sequence[Scored]) -> RiskCoverage | None:
    """The curve; None: no pose comes with a confidence. Equal confidences are one level."""
    known = _with_confidence(cases)
    if not known:
        return None
    confidence = np.array([case.confidence for case in known], np.float64)  # (n,)
    order = np.argsort(-confidence, kind="stable")
    wrong = np.cumsum([not known[k].is_right for k in order])
    ends = np.flatnonzero(np.diff(confidence[order], append=-1.0))
    return RiskCoverage((ends + 1) / len(cases), wrong[ends] / (ends + 1))


def reliability(cases: Sequence[Scored]) -> list[Bin]:
    """The steps of confidence that hold poses, from low to high."""
    steps: dict[int, list[Scored]] = {}
    for case in _with_confidence(cases):
        assert case.confidence is not None
        steps.setdefault(min(int(case.confidence * BINS), BINS - 1), []).append(case)
    return [
        Bin(
            len(found),
            float(np.mean([case.confidence for case in found if case.confidence is not None])),
            float(np.mean([case.is_right for case in found])),
        )
        for _, found in sorted(steps.items())
    ]


def calibration_error(bins: Sequence[Bin]) -> float | None:
    """The expected calibration error (ECE): mean distance of confidence and share that is right."""
    total = sum(one.count for one in bins)
    return sum(one.count * abs(one.confidence - one.right) for one in bins) / total if total else None


def brier_score(cases: Sequence[Scored]) -> float | None:
    """The mean squared distance of the confidence from 1 (right) or 0 (wrong)."""
    known = [(case.confidence, case.is_right) for case in _with_confidence(cases)]
    squares = [(confidence - right) ** 2 for confidence, right in known if confidence is not None]
    return float(np.mean(squares)) if squares else None


def report_of(cases: Sequence[Scored]) -> dict[str, Any]:
    """All metrics. A share of nothing is None.

    ``success_*``: of the scans of the map. ``right_first``: the same with 0.2 m and 1 degree, whether or not
    the system vouches for its pose. ``false_accepts`` are counted over all cases, those outside the map too.
    """
    inside = [case for case in cases if case.is_inside]
    times = [case.time_s for case in cases if case.time_s is not None]
    curve = risk_coverage(cases)
    tight_m, tight_deg = SUCCESS[0]
    return {
        "cases": len(cases),
        "outside": len(cases) - len(inside),
        "accepted": sum(case.is_accepted for case in cases),
        "no_pose": sum(not case.has_pose for case in cases),
        **{f"success_{m:g}m_{deg:g}deg": _rounded(success_rate(cases, m, deg)) for m, deg in SUCCESS},
        "right_first": _rounded(_share([case.is_within(tight_m, tight_deg) for case in inside])),
        "false_accepts": sum(case.is_false_accept for case in cases),
        "area_under_risk_coverage": _rounded(curve.area if curve else None),
        **{f"coverage_at_risk_{r:g}": _rounded(curve.coverage_at(r) if curve else None) for r in RISKS},
        "ece": _rounded(calibration_error(reliability(cases))),
        "brier": _rounded(brier_score(cases)),
        **{f"time_s_p{q}": _rounded(float(np.percentile(times, q)) if times else None) for q in (50, 95)},
    }


def _with_confidence(cases: Sequence[Scored]) -> list[Scored]:
    return [case for case in cases if case.has_pose and case.confidence is not None]


def _share(flags: Sequence[bool]) -> float | None:
    return float(np.mean(flags)) if flags else None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, DIGITS)
