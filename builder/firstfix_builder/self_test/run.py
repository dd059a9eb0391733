"""The self-test of a version, before it is published.

Perturbed scans are simulated between the templates, and scans of strange places ship with the release. The
real localizer answers them. The results are the success rate of the version, and the calibration of its
probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.scan.compact import CompactScan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse, make_transform

from ..simulation.perturb import ScanCase, ScanSimulation
from ..simulation.simulate import Simulator
from .alias_leads import SCANS, alias_tie_width, aliases_among, lead_lost
from .equal_places import equal_places, tie_width
from .localizability import QueriedPlace, grid_of
from .outcome import RIGHT_M, Outcome
from .prior_asks import PriorAsks, PriorOutcome, teach_with_prior
from .real_scans import RealScans, disagreeing
from .reliability import ABSENT_WEIGHT, Case, bound_of, fit, judged, reliability_of
from .strangers import drawn_strangers
from .taught_outcomes import taught_outcomes
from .threshold import TOLD, Judged, choose

LIMITS_M = (0.05, 0.2, 0.5, 1)


@dataclass(frozen=True)
class SelfTest:
    """Results of ``queries`` perturbed scans in the map and ``outside`` scans of strange places.

    Attributes:
        success: by limit, such as "0.2m": share of the queries whose best hypothesis is within the limit.
        among: the same for any hypothesis: the place was found, but not necessarily ranked first.
        localized: share of the queries answered ``localized``.
        found: share of the queries whose place is the best hypothesis, or ties with it. Equal storeys and
            known aliases tie: they make a map no worse.
        parts: ``queries``, ``success``, ``found`` and ``localized`` of those disturbed "as real" scans are,
            and of those disturbed "roughly".
        median_error_m: of the best hypotheses; None if half of the queries or more have none.
        false_accepts: number of answers ``localized`` that were off by over 1 m or 10 degrees, or outside.
        reliability: result of ``reliability.reliability_of`` for all of them.
        false_accept_bound: result of ``reliability.bound_of``, with hard negatives.
        threshold: result of ``threshold.choose`` for the config's promise; ``others``: for those of ``TOLD``.
        localizability: result of ``localizability.grid_of`` for the queries; the build adds what
            ``mapped_places.MappedPlaces`` knows.
        real: the same of the real scans that were asked too: their number ``asked``, the ``weight`` of each
            among the calibration's cases, ``success``, ``localized``, ``median_error_m`` and
            ``false_accepts``; ``of_source``, how many of the scans came with the map's source, and how many
            of them were found; ``disagree``, which shares differ from those of the simulated scans by more
            than chance; ``left_out``, with reasons; ``held_out``, ``RealScans.parts``; and ``confirmed``,
            ``RealScans.confirmations``.
        with_prior: ``TaughtWithPrior.report``.
    """

    queries: int
    outside: int
    success: dict[str, float]
    among: dict[str, float]
    localized: float
    found: float
    parts: dict[str, dict[str, Any]]
    median_error_m: float | None
    false_accepts: int
    reliability: dict[str, Any]
    false_accept_bound: dict[str, Any]
    threshold: dict[str, Any]
    localizability: list[dict[str, object]]
    real: dict[str, Any] = field(default_factory=dict)
    with_prior: dict[str, Any] = field(default_factory=dict)

    def to_mapping(self) -> dict[str, Any]:
        """Returns the results as JSON values."""
        return asdict(self)


def run_self_test(
    localizer: Localizer,
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    real: RealScans,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> tuple[SelfTest, Calibration, FalseAcceptBound, list[QueriedPlace]]:
    """Runs the test in the index's levelled frame; the localizer's own T_map_level is undone.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    rng = np.random.default_rng(config.seed)
    templates = localizer.index.cascade.templates
    rough = ScanSimulation(simulator, sensor, config.perturb_roughly)
    roughly = round(config.rough * config.queries)
    parts = (
        (rough, roughly),
        (ScanSimulation(simulator, sensor, config.perturb), config.queries - roughly),
    )
    inside = [
        (simulation, case)
        for simulation, count in parts
        for case in simulation.cases(templates.position_m, localizer.index.config.spacing_m, count, rng)
    ]
    queries: list[tuple[ScanSimulation, ScanCase] | CompactScan]
    queries = [*inside, *drawn_strangers(config.outside, rng)]
    asked_with = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))
    T_map_level, ranking = localizer.index.T_map_level, localizer.index.config.ranking
    T_level_map = inverse(T_map_level)
    done = 0

    def run(number: int) -> Outcome:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        asked = queries[number]
        if isinstance(asked, CompactScan):
            outcome = Outcome.nowhere(number, localizer.localize(asked))
        else:
            simulation, case = asked
            scan = simulation.scan(case)
            answer = localizer.localize(scan, asked_with)
            equals = equal_places(answer, simulator, sensor, case.T_level_sensor, T_level_map, ranking)
            lost = lead_lost(localizer, rough, case, asked_with) if number < SCANS else None
            outcome = Outcome.here(number, answer, case.T_level_sensor, T_map_level)
            aliases = aliases_among(localizer, scan, answer, asked_with)
            is_rough = simulation is rough
            outcome = replace(outcome, equals=equals, lead_lost=lost, aliases=aliases, is_rough=is_rough)
        ticked()
        return outcome

    def run_real(number: int) -> Outcome:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        one = real.scans[number]
        options = real.options_of(number, asked_with)
        answer = localizer.localize(one.scan, options)
        outcome = Outcome.here(real.query(number, len(queries)), answer, one.T_sensor, T_map_level)
        aliases = aliases_among(localizer, one.scan, answer, options)
        ticked()
        return replace(outcome, aliases=aliases, is_real=True)

    def ticked() -> None:
        nonlocal done
        done += 1
        progress(done / (2 * len(queries) + len(real.scans)))

    outcomes = list(executor.map(run, range(len(queries))))
    outcomes += executor.map(run_real, range(len(real.scans)))
    priors = PriorAsks(localizer, simulator, sensor, asked_with, config.seed)

    def run_with_prior(outcome: Outcome) -> list[PriorOutcome]:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        asked = queries[outcome.query]
        found = priors.outcomes(outcome, asked if isinstance(asked, CompactScan) else asked[0].scan(asked[1]))
        ticked()
        return found

    free = [outcome for outcome in outcomes if not outcome.is_real]
    with_prior = [outcome for of_query in executor.map(run_with_prior, free) for outcome in of_query]
    min_margin = tie_width([outcome.equals.unequal_by for outcome in outcomes])
    alias_margin = alias_tie_width(
        [outcome.lead_lost for outcome in outcomes], min_margin, ranking.max_margin
    )
    outcomes = [replace(outcome, min_margin=min_margin, ranking=ranking) for outcome in outcomes]
    of_real = real.weight(len(inside))

    def weight_of(outcome: Outcome) -> float:
        return of_real if outcome.is_real else 1.0

    cases = _cases(outcomes, weight_of)
    calibration = replace(fit(cases), min_margin=min_margin, alias_margin=alias_margin)
    seen = judged(cases, calibration)
    seen += [Judged(-1.0, False, o.is_in_map, weight_of(o)) for o in outcomes if o.evidence is None]
    taught = taught_outcomes()
    threshold = choose(seen, config.max_false_accept, taught.ceiling(config.max_false_accept))
    calibration = replace(
        calibration,
        min_probability=threshold.min_probability,
        search_until=choose(seen, config.max_false_accept, None).min_probability,
    )
    of_priors = teach_with_prior(with_prior, calibration, config.max_false_accept)
    if of_priors is not None:
        calibration = replace(calibration, with_prior=of_priors.calibration)
    simulated = [outcome for outcome in outcomes if not outcome.is_real]
    tested = _queried_places(simulated, calibration, T_level_map)
    bound = bound_of(cases, unanswered=sum(o.evidence is None for o in outcomes))
    others = [choose(seen, share, taught.ceiling(share)).to_mapping() for share in TOLD]
    told = {**threshold.to_mapping(), "others": others, "taught": taught.to_mapping()}
    found = _summary(simulated, calibration, cases, bound, told, grid_of(tested))
    compared = _of_real(found, [o for o in outcomes if o.is_real], calibration, real, of_real)
    found = replace(found, real=compared, with_prior={} if of_priors is None else of_priors.report)
    return found, calibration, bound, tested


def _queried_places(
    outcomes: Sequence[Outcome], calibration: Calibration, T_level_map: Matrix
) -> list[QueriedPlace]:
    """The queries in the map, each with the most similar place elsewhere."""
    places = []
    for outcome in outcomes:
        if outcome.T_level_sensor is None:
            continue
        here = outcome.T_level_sensor[:3, 3]
        found = [(T_level_map @ h.T_map_sensor)[:3, 3] for h in outcome.answer.hypotheses]
        elsewhere = [at for at in found if np.linalg.norm(at - here) > RIGHT_M]
        accepted = outcome.accepted_by(calibration)
        named = ("localized" if outcome.right else "wrong") if accepted else "unsure"
        rival = elsewhere[0] if elsewhere else None
        places.append(QueriedPlace(here, named, rival, outcome.found_by(calibration)))
    return places


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


def _summary(
    outcomes: Sequence[Outcome],
    calibration: Calibration,
    cases: Sequence[Case],
    bound: FalseAcceptBound,
    threshold: dict[str, Any],
    localizability: list[dict[str, object]],
) -> SelfTest:
    inside = [outcome for outcome in outcomes if outcome.T_level_sensor is not None]
    errors = np.array([outcome.first_error_m for outcome in inside])
    accepted = [o for o in outcomes if o.accepted_by(calibration)]
    return SelfTest(
        queries=len(inside),
        outside=len(outcomes) - len(inside),
        success=_shares(errors),
        among=_shares(np.array([outcome.least_error_m for outcome in inside])),
        localized=_localized(inside, calibration),
        found=_share([o.found_by(calibration) for o in inside]),
        parts={
            "as real": _part([outcome for outcome in inside if not outcome.is_rough], calibration),
            "roughly": _part([outcome for outcome in inside if outcome.is_rough], calibration),
        },
        median_error_m=_median(errors),
        false_accepts=sum(not o.right for o in accepted),
        reliability=reliability_of(cases),
        false_accept_bound=bound.to_mapping(),
        threshold=threshold,
        localizability=localizability,
    )


def _part(outcomes: Sequence[Outcome], calibration: Calibration) -> dict[str, Any]:
    return {
        "queries": len(outcomes),
        "success": _shares(np.array([outcome.first_error_m for outcome in outcomes])),
        "found": _share([outcome.found_by(calibration) for outcome in outcomes]),
        "localized": _localized(outcomes, calibration),
    }


def _of_real(
    found: SelfTest, outcomes: Sequence[Outcome], calibration: Calibration, real: RealScans, weight: float
) -> dict[str, Any]:
    """``SelfTest.real``; empty if the source has no real scans."""
    if not outcomes and not real.left_out and real.of_map is None:
        return {}
    errors = np.array([outcome.first_error_m for outcome in outcomes])
    success, localized = _shares(errors), _localized(outcomes, calibration)
    of_source = [
        o.found_by(calibration)
        for o, one in zip(outcomes, real.scans, strict=True)
        if one.confirmation is None
    ]
    return {
        "asked": len(outcomes),
        "weight": round(weight, 4),
        "success": success,
        "localized": localized,
        "median_error_m": _median(errors),
        "false_accepts": sum(o.accepted_by(calibration) and not o.right for o in outcomes),
        "of_source": {"asked": len(of_source), "found": sum(of_source)},
        "disagree": disagreeing(
            {**success, "localized": localized},
            {**found.success, "localized": found.localized},
            (len(outcomes), found.queries),
        ),
        "left_out": dict(sorted(real.left_out.items())),
        "held_out": real.parts(),
        "confirmed": real.confirmations(),
    }


def _localized(outcomes: Sequence[Outcome], calibration: Calibration) -> float:
    return _share([o.accepted_by(calibration) for o in outcomes])


def _share(of: Sequence[bool]) -> float:
    return round(float(np.mean(of)), 4) if of else 0.0


def _median(errors_m: NDArray[np.float64]) -> float | None:
    """Median error; None if there is none, as half of the scans or more found no place."""
    median = float(np.median(errors_m)) if len(errors_m) else np.inf
    return round(median, 4) if np.isfinite(median) else None


def _shares(errors_m: NDArray[np.float64]) -> dict[str, float]:
    """Share of the errors within each limit."""
    return {
        f"{limit}m": round(float(np.mean(errors_m <= limit)), 4) if len(errors_m) else 0.0
        for limit in LIMITS_M
    }
