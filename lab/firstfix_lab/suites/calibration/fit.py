"""Fits the prior to the cases of some worlds, and asks it about the cases of others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import WEIGHTS, Calibration
from firstfix.engine.ranking import RANKING, MatchFeatures
from firstfix_builder.self_test.reliability import ABSENT_WEIGHT

from ..robust.figures import calibration_error
from .cases import Case

RARE = ("absent", "alike")  # kinds of places that a map lacks, and that look as if they were in it
RIDGE = 1e-3  # keeps the fit finite where all cases are told apart
_REMOVED, _VIOLATION = (0.02, 0.03, 0.04, 0.055, 0.08), (0.03, 0.045, 0.06, 0.085, 0.12)


@dataclass(frozen=True)
class Judged:
    """A case as the calibration sees it.

    Attributes:
        right: the best place is right. among: it or one that ties with it is.
    """

    case: Case
    features: MatchFeatures
    right: bool
    among: bool

    @classmethod
    def of(cls, case: Case) -> Judged:
        """The case, its places ranked by their support."""
        places = sorted(case.places, key=lambda place: -RANKING.support(place.quality))
        features = RANKING.match_features([place.quality for place in places], Calibration().min_margin)
        return cls(case, features, places[0].right, any(place.right for place in places[: features.tied]))


def fit(judged: Sequence[Judged]) -> Calibration:
    """The likeliest calibration. As in a self-test, cases whose best places tie teach nothing."""
    single = [one for one in judged if one.features.tied == 1]
    inputs = np.array([[1.0, *one.features.vector] for one in single])
    truth = np.array([float(one.right) for one in single])
    counts = np.array([ABSENT_WEIGHT if one.case.kind in RARE else 1.0 for one in single])

    def loss(weights: NDArray[np.float64]) -> float:
        log_odds = inputs @ weights
        return float(counts @ (np.logaddexp(0, log_odds) - truth * log_odds) + RIDGE * weights @ weights)

    prior = Calibration().weights
    bounds = [(None, None)] + [(0, None)] * (len(prior) - 1)
    found = minimize(loss, prior, method="L-BFGS-B", bounds=bounds).x
    return replace(Calibration(), **dict(zip(WEIGHTS, (round(float(v), 2) for v in found), strict=True)))


def figures(judged: Sequence[Judged], calibration: Calibration) -> dict[str, Any]:
    """Judgement of a calibration by cases that it was not fitted to.

    ``right_first`` and ``localized`` are numbers of the scans ``inside``; ``ambiguous`` of those whose best
    places tie, ``with_truth`` the part that has the right one among them. ``false_accepts`` are of the scans
    inside or outside of the map, ``false_if_absent`` of those whose place is taken away, ``false_if_alike``
    of those of another place of the same kind. ``ece`` is of the scans inside or outside.
    """
    inside = [one for one in judged if one.case.kind == "inside"]
    asked = [one for one in judged if one.case.kind not in RARE]
    accepted = [one for one in judged if calibration.accepts(one.features)]
    tied = [one for one in inside if one.features.tied > 1]
    return {
        "inside": len(inside),
        "right_first": sum(one.right for one in inside),
        "localized": sum(one.right for one in accepted),
        "ambiguous": len(tied),
        "with_truth": sum(one.among for one in tied),
        "false_accepts": sum(not one.right for one in accepted if one.case.kind not in RARE),
        "absent": sum(one.case.kind == "absent" for one in judged),
        "false_if_absent": sum(one.case.kind == "absent" for one in accepted),
        "alike": sum(one.case.kind == "alike" for one in judged),
        "false_if_alike": sum(one.case.kind == "alike" for one in accepted),
        "ece": calibration_error(
            [calibration.probability(one.features) for one in asked], [one.among for one in asked]
        ),
    }


def leave_one_out(judged: Mapping[str, Sequence[Judged]], place_of: Mapping[str, str]) -> dict[str, Any]:
    """Figures of each world, by a calibration fitted to the worlds of other places, and of all together."""
    rows, together = {}, []
    for name, own in judged.items():
        others = [
            one for other, cases in judged.items() if place_of[other] != place_of[name] for one in cases
        ]
        calibration = fit(others)
        rows[name] = figures(own, calibration)
        together.append((own, calibration))
    total: dict[str, Any] = {
        key: sum(row[key] for row in rows.values()) for key in next(iter(rows.values())) if key != "ece"
    }
    claims = [
        (calibration.probability(one.features), one.among)
        for own, calibration in together
        for one in own
        if one.case.kind not in RARE
    ]
    total["ece"] = calibration_error([claim for claim, _ in claims], [right for _, right in claims])
    return {**rows, "all": total}


def support_weights(cases: Mapping[str, Sequence[Case]]) -> list[dict[str, Any]]:
    """For several weights of the two free-space shares: how many scans have the right place first, by world.

    The weight of the alignment score is that in use: only ratios matter. Best first.
    """
    rows = []
    for removed, violation in product(_REMOVED, _VIOLATION):
        first = {
            name: sum(_is_right_first(case, _support(removed, violation)) for case in own)
            for name, own in cases.items()
        }
        rows.append({"removed": removed, "violation": violation, "all": sum(first.values()), **first})
    return sorted(rows, key=lambda row: -row["all"])


def _support(removed: float, violation: float) -> Callable[[AlignmentQuality], float]:
    return RANKING.model_copy(update={"removed_weight": removed, "violation_weight": violation}).support


def _is_right_first(case: Case, support_of: Callable[[AlignmentQuality], float]) -> bool:
    return case.kind == "inside" and max(case.places, key=lambda place: support_of(place.quality)).right


def defaults_of(calibration: Calibration) -> dict[str, float]:
    """The numbers for ``Calibration``'s defaults."""
    values = asdict(calibration)
    return {name: values[name] for name in WEIGHTS}
