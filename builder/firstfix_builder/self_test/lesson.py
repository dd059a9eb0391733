"""The lesson of a self-test's outcomes: calibration, tie widths and threshold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.ranking import RankingConfig

from .alias_leads import alias_tie_width
from .equal_places import tie_width
from .outcome import Outcome
from .reliability import ABSENT_WEIGHT, Case, CrossValidated, fit
from .taught_outcomes import taught_outcomes
from .threshold import TOLD, Judged, choose, is_settled


@dataclass(frozen=True)
class Lesson:
    """Outcomes, and what they teach.

    Attributes:
        outcomes: with the map's tie width and ranking.
        checked: their cases.
        judged: the same for the choice of the threshold, and outcomes without a place.
        calibration: without that of queries with a prior.
        threshold: ``SelfTest.threshold``.
        is_settled: whether the threshold stays if the queries left to ask come out as these did.
    """

    outcomes: tuple[Outcome, ...]
    checked: CrossValidated
    judged: tuple[Judged, ...]
    calibration: Calibration
    threshold: dict[str, Any]
    is_settled: bool

    @classmethod
    def of(
        cls,
        outcomes: Sequence[Outcome],
        of_real: float,
        ranking: RankingConfig,
        config: SelfTestConfig,
        asked: float,
    ) -> Lesson:
        """The lesson of outcomes.

        Args:
            of_real: weight of a real scan, against a simulated one.
            asked: 0..1, share of the planned queries that were asked.
        """
        min_margin, alias_margin = tie_widths(outcomes, ranking, asked)
        outcomes = [replace(one, min_margin=min_margin, ranking=ranking) for one in outcomes]

        def weight_of(outcome: Outcome) -> float:
            return of_real if outcome.is_real else 1.0

        cases = _cases(outcomes, weight_of)
        checked = CrossValidated.of(cases)
        calibration = replace(fit(cases), min_margin=min_margin, alias_margin=alias_margin)
        seen = checked.judged(calibration)
        seen += [Judged(-1.0, False, o.is_in_map, weight_of(o)) for o in outcomes if o.evidence is None]
        taught, promise = taught_outcomes(), config.max_false_accept
        ceiling = taught.ceiling(promise)
        threshold = choose(seen, promise, ceiling, asked)
        others = [choose(seen, share, taught.ceiling(share), asked).to_mapping() for share in TOLD]
        calibration = replace(
            calibration,
            min_probability=threshold.min_probability,
            search_until=choose(seen, promise, None, asked).min_probability,
        )
        return cls(
            tuple(outcomes),
            checked,
            tuple(seen),
            calibration,
            {**threshold.to_mapping(), "others": others, "taught": taught.to_mapping()},
            is_settled(seen, promise, ceiling, asked),
        )

    @property
    def simulated(self) -> list[Outcome]:
        """The outcomes of all scans but the real ones."""
        return [one for one in self.outcomes if not one.is_real]

    def bound(self) -> FalseAcceptBound:
        """The bound on false accepts of the version."""
        return self.checked.bound(unanswered=sum(one.evidence is None for one in self.outcomes))


def tie_widths(outcomes: Sequence[Outcome], ranking: RankingConfig, asked: float) -> tuple[float, float]:
    """The ``min_margin`` and the ``alias_margin`` that outcomes teach.

    Args:
        asked: 0..1, share of the planned queries that were asked.
    """
    min_margin = tie_width([one.equals.unequal_by for one in outcomes], asked)
    lost = [one.lead_lost for one in outcomes]
    return min_margin, alias_tie_width(lost, min_margin, ranking.max_margin, asked)


def _cases(outcomes: Sequence[Outcome], weight_of: Callable[[Outcome], float]) -> list[Case]:
    cases = []
    for outcome in outcomes:
        weight = weight_of(outcome)
        if outcome.evidence is not None:
            right = outcome.right_among_tied
            cases.append(Case(outcome.query, outcome.evidence, right, weight, is_in_map=outcome.is_in_map))
        absent = outcome.without_the_truth
        if absent is not None:
            rare = ABSENT_WEIGHT * weight
            cases.append(Case(outcome.query, absent, False, rare, asked=False, is_in_map=False))
    return cases
