"""Do the probabilities come true? The self-test's cases, each asked of a model that has not seen it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.ranking import MatchFeatures

from ..plot import BLUE, GREY, Plot
from .threshold import Judged

# Of a scan as if its place were not in the map, against a scan of the map. Robots are mostly where their map
# is (docs/method.md section 7).
ABSENT_WEIGHT = 0.1
FOLDS = 5
BINS = 10


@dataclass(frozen=True)
class Case:
    """One query as training data of the calibration.

    Attributes:
        query: cases of one query are never on both sides of a fold.
        right: whether the best place was, or one that ties with it.
        weight: how many such cases there would be among real ones.
        asked: whether the query was really asked; else it is what would have been found had the true
            place not been in the map.
        is_in_map: whether the scan was taken in the map, and asked as it is.
    """

    query: int
    evidence: MatchFeatures
    right: bool
    weight: float = 1.0
    asked: bool = True
    is_in_map: bool = True


def fit(cases: Sequence[Case]) -> Calibration:
    """The calibration that the cases teach.

    Which margin a place without an equal needs is learned from such places alone. Scans whose best places tie
    are left out there, together with their hard negatives: alone these would teach that nothing is ever
    right. How likely one of several places that tie is right, all cases teach.
    """
    tied = {case.query for case in cases if case.asked and case.evidence.tied > 1}
    single = [case for case in cases if case.query not in tied and case.evidence.tied == 1]
    fitted = _fit(single)
    return fitted if len(single) == len(cases) else fitted.with_ties_as_in(_fit(cases))


def _fit(cases: Sequence[Case]) -> Calibration:
    if not cases:
        return Calibration()
    return Calibration.fit(*zip(*((c.evidence, c.right, c.weight) for c in cases), strict=True))


@dataclass(frozen=True)
class CrossValidated:
    """Cases, each with a calibration that was not fitted on its query.

    Attributes:
        cases: (n,) of them.
        models: (n,) that of each case.
        claims: (n,) probability that it claims for the case.
    """

    cases: tuple[Case, ...]
    models: tuple[Calibration, ...]
    claims: tuple[float, ...]

    @classmethod
    def of(cls, cases: Sequence[Case]) -> CrossValidated:
        """Fit FOLDS calibrations, each without a fold of the queries."""
        folds = [fit([case for case in cases if case.query % FOLDS != fold]) for fold in range(FOLDS)]
        models = tuple(folds[case.query % FOLDS] for case in cases)
        claims = tuple(model.probability(one.evidence) for one, model in zip(cases, models, strict=True))
        return cls(tuple(cases), models, claims)

    def reliability(self) -> dict[str, Any]:
        """Shares of the claims that came true.

        Returns ``expected_calibration_error`` and ``bins``: the number of ``cases`` in each, the mean
        probability that was ``claimed`` for them, and the share that was ``right``.
        """
        every = zip(self.cases, self.claims, strict=True)
        asked = [(claim, float(case.right)) for case, claim in every if case.asked]
        claimed, right = np.array(asked).reshape(-1, 2).T
        number = np.minimum((claimed * BINS).astype(int), BINS - 1)
        bins = []
        for k in np.unique(number):
            here = number == k
            bins.append(
                {
                    "cases": int(here.sum()),
                    "claimed": round(float(claimed[here].mean()), 4),
                    "right": round(float(right[here].mean()), 4),
                }
            )
        gaps = np.bincount(number, claimed - right, minlength=BINS)
        error = round(float(np.abs(gaps).sum() / len(claimed)), 4) if len(claimed) else None
        return {"expected_calibration_error": error, "bins": bins}

    def bound(self, unanswered: int = 0) -> FalseAcceptBound:
        """The bound on false accepts that the wrong cases show, asked or not.

        Args:
            unanswered: number of further wrong cases that no calibration would accept.
        """
        claimed = [
            claim if model.accepts(case.evidence, 0.0) else -1.0
            for case, model, claim in zip(self.cases, self.models, self.claims, strict=True)
            if not case.right
        ]
        return FalseAcceptBound.of(claimed + [-1.0] * unanswered)

    def judged(self, calibration: Calibration) -> list[Judged]:
        """The cases as the choice of the threshold sees them.

        A wrong case counts by the larger of two probabilities: of a model that has not seen it, and of the
        calibration that the map gets.
        """
        found = []
        for case, model, claim in zip(self.cases, self.models, self.claims, strict=True):
            if not case.right:
                claim = max(claim, calibration.probability(case.evidence))
            claimed = claim if model.accepts(case.evidence, 0.0) else -1.0
            found.append(Judged(claimed, case.right, case.is_in_map, case.weight, case.asked))
        return found


def draw_reliability(reliability: dict[str, Any], path: Path) -> None:
    """PNG: what was claimed against what came true, a disc's area the number of cases."""
    plot = Plot((-0.05, 1.05, -0.05, 1.05), 1.1 / 480)
    plot.lines(np.zeros((1, 2)), np.ones((1, 2)), GREY)
    for part in reliability["bins"]:
        place = part["claimed"], part["right"]
        plot.marks(np.array([place]), BLUE, math.sqrt(20 + 3 * part["cases"]), opacity=0.6)
        plot.text(place, str(part["cases"]))
    error = reliability["expected_calibration_error"]
    plot.save(path, x="probability claimed", y="share right", title=f"expected calibration error {error}")
