"""Queries with a prior: each scan of the self-test is asked with a right one, and with a wrong one.

With a prior only what lies in it competes. So another share of the answers is right than without, and a
calibration of their own is fitted to them. In a hall whose places all have an equal elsewhere, nothing else
can teach how good a fit must be: without a prior, every answer ties.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.calibration import Calibration
from firstfix.engine.localizer import Localizer
from firstfix.engine.with_prior import MAX_RADIUS_M, MIN_RADIUS_M
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, yaw_of

from ..simulation.simulate import Simulator
from .asks import Asked
from .equal_places import EQUAL, share_seen_alike
from .outcome import RIGHT_M, Outcome
from .reliability import Case, CrossValidated, fit
from .threshold import ABSENT_SHARE, Judged, choose

YAW_RANGE_DEG = 45.0  # of the priors with a heading: every other one
_OFF_CENTRE = 0.9  # of radius and range, within which the truth lies in a right prior
_MIN = 0.5  # probability from which on an answer is looked at closely, whatever threshold the map gets
MAX, OTHERS = 64, 16  # queries of a map that are asked with priors, and of these such as do not tie
_PLACES = 8  # drawn from the map, to find one that a wrong prior can be about


@dataclass(frozen=True)
class TaughtWithPrior:
    """Lesson of the queries with a prior.

    Attributes:
        calibration: of such queries.
        report: number of scans asked with a ``right`` and with a ``wrong`` prior, the share ``found`` of the
            former whose best place is right, the share ``localized`` of them, the number of
            ``false_accepts``, and ``min_probability``, the threshold.
    """

    calibration: Calibration
    report: dict[str, Any]


@dataclass(frozen=True)
class PriorOutcome:
    """A scan of the map that was asked with a prior.

    Attributes:
        outcome: with a wrong prior that of a scan that was taken at no place in it.
        behind: support by which the best place in a wrong prior is behind the true one, which was found with
            the right prior; None: the prior is right, or the true place was not found.
        is_equal: whether a sensor sees the same in the best place of a wrong prior as in the true one.
        is_refused: whether the answer is not localized however low the threshold is: an alias in the prior
            ties, one outside it is better, or the alignment does not rest.
    """

    outcome: Outcome
    behind: float | None = None
    is_equal: bool = False
    is_refused: bool = False

    def can_be_told(self, min_margin: float) -> bool:
        """Whether the answer can be known to be wrong: its place is not as good as the true one."""
        return not self.is_equal and (self.behind is None or self.behind >= min_margin)


@dataclass
class WorthAPrior:
    """Choice of the queries that are asked again with priors: those whose best places tie, and some others.

    A prior changes most where places tie. Elsewhere few are enough to see what it changes.

    Args:
        rng: chooses where there are more.
        is_enough: choose no more.
    """

    rng: np.random.Generator
    is_enough: bool = False
    _chosen: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})

    def of(self, free: Sequence[Asked], share: float) -> list[Asked]:
        """The chosen ones of further queries without a prior.

        Args:
            share: 0..1, of all planned queries, that has been asked with these.
        """
        found: dict[bool, list[Asked]] = {True: [], False: []}
        for row in self.rng.permutation(len(free)).tolist():
            evidence = free[row].outcome.evidence
            found[evidence is not None and evidence.tied > 1].append(free[row])
        chosen: list[Asked] = []
        if self.is_enough:
            return chosen
        for is_tied, most in ((True, MAX - OTHERS), (False, OTHERS)):
            several = found[is_tied][: round(most * share) - self._chosen[is_tied]]
            self._chosen[is_tied] += len(several)
            chosen += several
        return chosen


@dataclass(frozen=True)
class PriorAsks:
    """Asks scans of the map with priors.

    Attributes:
        options: of the self-test's queries.
        seed: of the priors.
    """

    localizer: Localizer
    simulator: Simulator
    sensor: SensorModel
    options: LocalizeOptions
    seed: int

    def outcomes(self, free: Outcome, scan: Scan | CompactScan) -> list[PriorOutcome]:
        """The outcomes with a right prior, and with a wrong one if the map has a place for it.

        A scan of a strange place has none but wrong ones: that about its best place is asked.

        Args:
            free: outcome of the same scan without a prior.
        """
        T_level_sensor, T_map_level = free.T_level_sensor, self.localizer.index.T_map_level
        rng = np.random.default_rng([self.seed, free.query])
        radius_m = float(np.exp(rng.uniform(np.log(MIN_RADIUS_M), np.log(MAX_RADIUS_M))))
        off_m = _OFF_CENTRE * radius_m * _in_ball(rng)
        if T_level_sensor is None:
            return [
                _told(Outcome.nowhere(free.query, self._asked(scan, Prior(place_m + off_m, radius_m))))
                for place_m in islice(self._elsewhere(free, 180.0, rng), 1)
            ]
        T_map_sensor = T_map_level @ T_level_sensor
        yaw_range_deg = YAW_RANGE_DEG if free.query % 2 else 180.0
        yaw_deg = np.degrees(yaw_of(T_map_sensor)) + _OFF_CENTRE * yaw_range_deg * rng.uniform(-1, 1)
        right = Prior(T_map_sensor[:3, 3] + off_m, radius_m, float(yaw_deg), yaw_range_deg)
        found = Outcome.here(free.query, self._asked(scan, right), T_level_sensor, T_map_level)
        for place_m in self._elsewhere(free, yaw_range_deg, rng):
            wrong = replace(right, position_m=place_m + off_m)
            if np.linalg.norm(wrong.position_m - T_map_sensor[:3, 3]) > radius_m + RIGHT_M:
                return [_told(found), self._wrong(found, self._asked(scan, wrong))]
        return [_told(found)]

    def _wrong(self, right: Outcome, answer: Localization) -> PriorOutcome:
        """The outcome with a wrong prior, given that with the right one."""
        asked = _told(Outcome.nowhere(right.query, answer))
        if not answer.hypotheses or right.T_level_sensor is None:
            return asked
        T_level_found = inverse(self.localizer.index.T_map_level) @ answer.hypotheses[0].T_map_sensor
        is_equal = share_seen_alike(self.simulator, self.sensor, right.T_level_sensor, T_level_found) > EQUAL
        return replace(asked, behind=_behind(right, answer), is_equal=is_equal)

    def _asked(self, scan: Scan | CompactScan, prior: Prior) -> Localization:
        options = replace(self.options, prior=prior, min_probability=_MIN)
        return self.localizer.localize(scan, options)

    def _elsewhere(
        self, free: Outcome, yaw_range_deg: float, rng: np.random.Generator
    ) -> Iterator[NDArray[np.float64]]:
        """Positions (3,) in the map frame that a wrong prior may be about: the scan's best ones, then any.

        Places that tie with the best one are among them only if the prior has a heading: an equal place that
        is turned does not have the true one.
        """
        evidence = free.evidence
        tied = evidence.tied if evidence is not None and free.is_in_map and yaw_range_deg >= 180 else 0
        for one in free.answer.hypotheses[tied:]:
            yield one.T_map_sensor[:3, 3]
        index = self.localizer.index
        T, positions_m = index.T_map_level, index.cascade.templates.position_m
        for row in rng.integers(len(positions_m), size=_PLACES).tolist():
            yield T[:3, :3] @ np.asarray(positions_m[row], np.float64) + T[:3, 3]


def _told(outcome: Outcome) -> PriorOutcome:
    """The outcome, and whether it was refused for another reason than its probability."""
    evidence = outcome.evidence
    would_do = evidence is not None and evidence.tied == 1 and Calibration().accepts(evidence, _MIN)
    return PriorOutcome(outcome, is_refused=would_do and outcome.answer.verdict is not Verdict.LOCALIZED)


def _behind(right: Outcome, wrong: Localization) -> float | None:
    """``PriorOutcome.behind``."""
    supports = [
        None if h.quality is None else right.ranking.support(h.quality)
        for h in (*right.answer.hypotheses, wrong.hypotheses[0])
    ]
    true = [by for by, off_m in zip(supports, right.errors_m, strict=False) if by and off_m <= RIGHT_M]
    return max(true) - supports[-1] if true and supports[-1] is not None else None


def _in_ball(rng: np.random.Generator) -> NDArray[np.float64]:
    """A (3,) point of the unit ball, near its level plane: a robot knows its height better than its place."""
    level, angle = np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
    upright = 0.2 * rng.uniform(-1, 1) * np.sqrt(1 - level**2)
    return np.array([level * np.cos(angle), level * np.sin(angle), upright])


def teach_with_prior(
    asked: Sequence[PriorOutcome], of_all: Calibration, max_false_accept: float
) -> TaughtWithPrior | None:
    """The calibration of queries with a prior; None if none of them had an answer.

    One prior in nine is taken to be wrong, an assumption about robots like that on scans from elsewhere. What
    cannot be told teaches nothing: the best place of a wrong prior that is as good as the true one. Who gives
    a wrong prior once gives it again, so a rate of wrong answers is not enough: each answer is as probable as
    the promise asks.

    Args:
        asked: by ``PriorAsks``.
        of_all: calibration of the map's other queries, of which poses tie by the same margins.
    """
    told = [one for one in asked if one.can_be_told(of_all.alias_margin)]
    told = [replace(one, outcome=replace(one.outcome, min_margin=of_all.min_margin)) for one in told]
    right = [one for one in told if one.outcome.is_in_map]
    wrong = [one for one in told if not one.outcome.is_in_map]
    of_wrong = ABSENT_SHARE / (1 - ABSENT_SHARE) * len(right) / max(1, len(wrong))
    cases = [case for one in told if (case := _case(one, of_wrong)) is not None]
    if not cases:
        return None
    calibration = replace(fit(cases), min_margin=of_all.min_margin, alias_margin=of_all.alias_margin)
    never = [one.outcome for one in told if _case(one, of_wrong) is None]
    seen = CrossValidated.of(cases).judged(calibration)
    seen += [Judged(-1.0, one.right, one.is_in_map) for one in never]
    chosen = choose(seen, max_false_accept, None).min_probability
    threshold = max(chosen, round(1 - max_false_accept, 6))
    calibration = replace(calibration, min_probability=threshold, search_until=threshold)

    def is_accepted(one: PriorOutcome) -> bool:
        return not one.is_refused and one.outcome.accepted_by(calibration)

    accepted = [one for one in told if is_accepted(one)]
    report = {
        "right": len(right),
        "wrong": len(wrong),
        "found": _share(one.outcome.right for one in right),
        "localized": _share(is_accepted(one) for one in right),
        "false_accepts": sum(not one.outcome.right for one in accepted),
        "min_probability": calibration.min_probability,
    }
    return TaughtWithPrior(calibration, report)


def _case(one: PriorOutcome, of_wrong: float) -> Case | None:
    """The outcome as a case of the fit; None: its probability does not matter."""
    outcome, evidence = one.outcome, one.outcome.evidence
    if evidence is None or one.is_refused:
        return None
    is_right = outcome.is_in_map
    weight = 1.0 if is_right else of_wrong
    return Case(outcome.query, evidence, outcome.right_among_tied, weight, asked=is_right, is_in_map=is_right)


def _share(holds: Iterable[bool]) -> float:
    found = list(holds)
    return round(sum(found) / len(found), 4) if found else 0.0
