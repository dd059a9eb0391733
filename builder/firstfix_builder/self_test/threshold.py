"""The threshold of a map: from which probability on an answer is ``localized`` (docs/method.md section 11).

A user says how many of these answers may be wrong. The self-test finds the lowest threshold that keeps this,
with all its cases: scans of the map, and scans whose place the map lacks. Its few cases can rarely show it,
so many maps have taught a ceiling, and how often a negative is accepted at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.false_accept_bound import CONFIDENCE, THRESHOLDS, upper_bound

FLOOR = 0.9  # an answer more doubtful than this is never `localized`, however right the others are
ABSENT_SHARE = 1 / 9  # of queries come from a place that the map lacks (docs/method.md section 7)
TOLD = (0.01, 0.005, 0.001)  # what else the report tells of
RATE, MANY_MAPS, EACH = "rate", "many maps", "each answer"
STEPS = 1_000_000  # in which a threshold is told
# Beta distribution of the share of a map's negatives that are accepted at FLOOR, over many maps: 7 % in the
# mean, and none of a hundred in a third of the maps (docs/method.md section 11).
USUAL_ACCEPTED, USUAL_REFUSED = 0.35, 4.65


@dataclass(frozen=True)
class Judged:
    """One case, judged by a calibration that has not seen it.

    Attributes:
        claimed: probability of the best place; -1 where no threshold would accept it.
        right: whether that place, or one that ties with it, is right.
        is_in_map: whether the scan was taken in the map.
        weight: of the case among those in the map, or among those that are not.
        asked: whether the query was really asked; else it is a hard negative.
    """

    claimed: float
    right: bool
    is_in_map: bool
    weight: float = 1.0
    asked: bool = True


@dataclass(frozen=True)
class Ceiling:
    """A threshold at which many maps together keep a promise: no map's is higher.

    Attributes:
        min_probability: the threshold.
        bound: 0..1, with 95 % confidence no larger share of the answers ``localized`` is wrong, in all of
            them together.
    """

    min_probability: float
    bound: float


@dataclass(frozen=True)
class Threshold:
    """A promise and the threshold that keeps it.

    Attributes:
        max_false_accept: largest share of the answers ``localized`` that may be wrong.
        min_probability: the threshold.
        localized: share of the scans in the map that it accepts.
        bound: 0..1, with 95 % confidence no larger share of the answers ``localized`` is wrong.
        kept_by: "rate": the map's own cases show that the share is kept; "many maps": they are too few to
            show it, and the threshold is the ceiling, at which those of many maps show it; "each answer":
            neither do, so each answer is as probable as the promise asks.
    """

    max_false_accept: float
    min_probability: float
    localized: float
    bound: float
    kept_by: str

    def to_mapping(self) -> dict[str, Any]:
        """Values by name, ready for JSON."""
        return asdict(self)


def choose(
    cases: Sequence[Judged], max_false_accept: float, ceiling: Ceiling | None, asked: float = 1.0
) -> Threshold:
    """The lowest threshold that keeps a promise. Who allows more is never given a higher one.

    The map's own cases may show the rate of wrong answers: then it is the lowest one that keeps the promise
    and accepts no wrong place among them. Else each answer must be as probable as the promise asks, and more
    than the most probable wrong case. But it is never above the ceiling, unless the map's own scans refute
    that.

    Of a self-test that ended early the cases count as they are and as if all had been asked: the threshold is
    none that the whole test would not show.

    Args:
        max_false_accept: largest share of the answers ``localized`` that may be wrong.
        ceiling: for this share; None: many maps have taught none.
        asked: 0..1, share of the planned queries that were asked.
    """
    seen = _Seen.of(cases)

    def bound(threshold: float) -> float:
        return max(seen.bound(threshold, asked), seen.bound_by_all(threshold, asked))

    return _lowest(cases, seen, max_false_accept, ceiling, bound)


def is_settled(
    cases: Sequence[Judged], max_false_accept: float, ceiling: Ceiling | None, asked: float
) -> bool:
    """Whether ``choose`` finds what it would find if the queries left to ask came out as those asked did."""
    seen = _Seen.of(cases)
    foreseen = _lowest(
        cases, seen, max_false_accept, ceiling, lambda threshold: seen.bound_by_all(threshold, asked)
    )
    return foreseen.min_probability == choose(cases, max_false_accept, ceiling, asked).min_probability


def _lowest(
    cases: Sequence[Judged],
    seen: _Seen,
    max_false_accept: float,
    ceiling: Ceiling | None,
    bound_at: Callable[[float], float],
) -> Threshold:
    least = max(FLOOR, seen.above_the_worst)
    each = max(least, round(1 - max_false_accept, 6))
    shown = (one for one in THRESHOLDS if one >= least and bound_at(one) <= max_false_accept)
    chosen = min(next(shown, each), each)
    bound = bound_at(chosen)
    kept_by = RATE if bound <= max_false_accept else EACH
    if (
        ceiling is not None
        and ceiling.min_probability < chosen
        and not _refuted(cases, ceiling.min_probability, max_false_accept)
    ):
        chosen, bound, kept_by = ceiling.min_probability, ceiling.bound, MANY_MAPS
    return Threshold(max_false_accept, chosen, round(seen.localized(chosen), 4), bound, kept_by)


def _refuted(cases: Sequence[Judged], threshold: float, max_false_accept: float) -> bool:
    """Whether scans that were asked show, with 95 % confidence, that a threshold breaks a promise."""
    accepted = [case.right for case in cases if case.asked and case.claimed >= threshold]
    return 1 - upper_bound(sum(accepted), len(accepted)) > max_false_accept


@dataclass(frozen=True)
class _Seen:
    """Claimed probabilities of the cases, from which the rate of wrong answers at a threshold follows.

    Attributes:
        claimed, right, weight: (n,) of the cases in the map.
        wrong: (k,) claimed of all negatives: cases whose best place is wrong, in the map or not.
    """

    claimed: NDArray[np.float64]
    right: NDArray[np.bool_]
    weight: NDArray[np.float64]
    wrong: NDArray[np.float64]

    @classmethod
    def of(cls, cases: Sequence[Judged]) -> _Seen:
        inside = [case for case in cases if case.is_in_map]
        return cls(
            np.array([case.claimed for case in inside]),
            np.array([case.right for case in inside], bool),
            np.array([case.weight for case in inside]),
            np.array([case.claimed for case in cases if not case.right]),
        )

    @property
    def above_the_worst(self) -> float:
        """The lowest threshold that accepts no negative; at most 1."""
        worst = max(self.wrong.max(initial=0.0), 0.0)
        return min(1.0, math.floor(worst * STEPS + 1) / STEPS)

    def localized(self, threshold: float) -> float:
        """Share of the cases in the map that it accepts."""
        return self._share(self.claimed >= threshold)

    def bound(self, threshold: float, asked: float) -> float:
        """Upper bound of the wrong share of the answers ``localized`` (equation 11.2).

        Where not all queries were asked, by what is usual of maps (equation 11.4).
        """
        accepted, negatives = self._accepted(threshold), len(self.wrong)
        return self._wrong_share(
            threshold, upper_bound(accepted, negatives) if asked == 1 else _usually(accepted, negatives)
        )

    def bound_by_all(self, threshold: float, asked: float) -> float:
        """The bound that all queries would show if the rest of them came out as those that were asked."""
        accepted, negatives = self._accepted(threshold), len(self.wrong)
        return self._wrong_share(threshold, upper_bound(round(accepted / asked), round(negatives / asked)))

    def _accepted(self, threshold: float) -> int:
        return int((self.wrong >= threshold).sum())

    def _wrong_share(self, threshold: float, of_negatives: float) -> float:
        """Wrong share of the answers ``localized``, given the share of the negatives that is accepted."""
        in_map = 1 - ABSENT_SHARE
        negatives = ABSENT_SHARE + in_map * self._share(~self.right)
        false = negatives * of_negatives
        right = in_map * self._share(self.right & (self.claimed >= threshold))
        return math.ceil(false / (false + right) * STEPS) / STEPS

    def _share(self, chosen: NDArray[np.bool_]) -> float:
        return float(self.weight @ chosen / self.weight.sum()) if len(chosen) else 0.0


def _usually(accepted: int, negatives: int) -> float:
    """Share of negatives that is accepted, at most, with 95 % probability, in a map drawn from many."""
    from scipy.special import betaincinv  # imported late, as in ``upper_bound``

    exact = float(betaincinv(USUAL_ACCEPTED + accepted, USUAL_REFUSED + negatives - accepted, CONFIDENCE))
    return math.ceil(exact * STEPS) / STEPS
