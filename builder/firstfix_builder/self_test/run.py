"""The self-test of a version, before it is published.

Perturbed scans are simulated between the templates, and in a place that is not in the map. The real localizer
answers them. The results are the success rate of the version, and the calibration of its probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse, make_transform

from ..simulation.perturb import ScanCase, ScanSimulation, elsewhere
from ..simulation.simulate import Simulator
from .alias_leads import SCANS, alias_tie_width, aliases_among, lead_lost
from .equal_places import is_in_map, mirrored, tie_width, unequal_by
from .localizability import QueriedPlace, grid_of
from .outcome import RIGHT_M, Outcome
from .prior_asks import PriorAsks, PriorOutcome, teach_with_prior
from .real_scans import RealScans, disagreeing
from .reliability import ABSENT_WEIGHT, Case, bound_of, fit, judged, mirrored_weight, reliability_of
from .threshold import TOLD, Judged, choose

SURE = 0.5  # a mirror image that was found with a higher probability may be in the map
LIMITS_M = (0.05, 0.2, 0.5, 1)


@dataclass(frozen=True)
class SelfTest:
    """Results of ``queries`` perturbed scans in the map and ``outside`` scans from elsewhere.

    Attributes:
        mirrored: number of mirror images of the queries that were asked, without those that are in the map.
        success: by limit, such as "0.2m": share of the queries whose best hypothesis is within the limit.
        among: the same for any hypothesis: the place was found, but not necessarily ranked first.
        localized: share of the queries answered ``localized``.
        median_error_m: of the best hypotheses; None if half of the queries or more have none.
        false_accepts: number of answers ``localized`` that were off by over 1 m or 10 degrees, or outside.
        reliability: result of ``reliability.reliability_of`` for all of them.
        false_accept_bound: result of ``reliability.bound_of``, with mirror images and hard negatives.
        threshold: result of ``threshold.choose`` for the config's promise; ``others``: for those of ``TOLD``.
        localizability: result of ``localizability.grid_of`` for the queries; the build adds what
            ``mapped_places.MappedPlaces`` knows.
        real: the same of the real scans that were asked too: their number ``asked``, the ``weight`` of each
            among the calibration's cases, ``success``, ``localized``, ``median_error_m`` and
            ``false_accepts``; ``disagree``, which of these differ from those of the simulated scans by more
            than chance; ``left_out``, with reasons; ``held_out``, ``RealScans.parts``; and ``confirmed``,
            ``RealScans.confirmations``.
        with_prior: ``TaughtWithPrior.report``.
    """

    queries: int
    outside: int
    mirrored: int
    success: dict[str, float]
    among: dict[str, float]
    localized: float
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
    here = ScanSimulation(simulator, sensor, config.perturb)
    inside = here.cases(templates.position_m, localizer.index.config.spacing_m, config.queries, rng)
    strange = ScanSimulation(Simulator(*elsewhere(rng)), sensor, config.perturb)
    places = np.column_stack(
        [rng.uniform(-15, 15, (200, 2)), np.full(200, float(np.median(templates.height_m)))]
    )
    outside = strange.cases(places, 1.0, config.outside, rng)
    queries = [*((here, case) for case in inside), *((strange, case) for case in outside)]
    asked_with = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))
    T_map_level, ranking = localizer.index.T_map_level, localizer.index.config.ranking
    T_level_map = inverse(T_map_level)
    done = 0

    def run(number: int) -> list[Outcome]:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        simulation, case = queries[number]
        scan = simulation.scan(case)
        answer = localizer.localize(scan, asked_with)
        if simulation is strange:
            outcomes = [Outcome.nowhere(number, answer)]
        else:
            by = unequal_by(answer, simulator, sensor, case.T_level_sensor, T_level_map, ranking)
            lost = lead_lost(localizer, here, case, asked_with) if number < SCANS else None
            outcome = Outcome.here(number, answer, case.T_level_sensor, T_map_level)
            outcomes = [replace(outcome, unequal_by=by, lead_lost=lost)]
            if number < config.mirrored:
                image = localizer.localize(mirrored(scan, sensor), asked_with)
                if not _is_right(image, case):
                    outcomes.append(Outcome.nowhere(number, image, is_mirrored=True))
        ticked()
        return outcomes

    def run_real(number: int) -> Outcome:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        one = real.scans[number]
        answer = localizer.localize(one.scan, real.options_of(number, asked_with))
        query = real.query(number, len(queries))
        ticked()
        return replace(Outcome.here(query, answer, one.T_sensor, T_map_level), is_real=True)

    def ticked() -> None:
        nonlocal done
        done += 1
        progress(done / (2 * len(queries) + len(real.scans)))

    def _is_right(image: Localization, case: ScanCase) -> bool:
        """Returns whether the mirror image of the case's place was found, because the map has it too."""
        if image.probability < SURE or not image.hypotheses:
            return False
        found = T_level_map @ image.hypotheses[0].T_map_sensor
        return is_in_map(simulator, sensor, case.T_level_sensor, found)

    outcomes = [outcome for of_query in executor.map(run, range(len(queries))) for outcome in of_query]
    outcomes += executor.map(run_real, range(len(real.scans)))
    priors = PriorAsks(localizer, simulator, sensor, asked_with, config.seed)

    def run_with_prior(outcome: Outcome) -> list[PriorOutcome]:
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        simulation, case = queries[outcome.query]
        found = priors.outcomes(outcome, simulation.scan(case))
        ticked()
        return found

    free = [o for o in outcomes if not o.is_real and not o.is_mirrored]
    with_prior = [outcome for of_query in executor.map(run_with_prior, free) for outcome in of_query]
    min_margin = tie_width([outcome.unequal_by for outcome in outcomes])
    alias_margin = alias_tie_width(
        [outcome.lead_lost for outcome in outcomes], min_margin, ranking.max_margin
    )
    outcomes = [
        replace(
            outcome,
            min_margin=min_margin,
            aliases=aliases_among(localizer.index, outcome.answer),
            ranking=ranking,
        )
        for outcome in outcomes
    ]
    of_mirrored, of_real = mirrored_weight(len(inside), config.mirrored), real.weight(len(inside))

    def weight_of(outcome: Outcome) -> float:
        return of_mirrored if outcome.is_mirrored else of_real if outcome.is_real else 1.0

    cases = _cases(outcomes, weight_of)
    calibration = replace(fit(cases), min_margin=min_margin, alias_margin=alias_margin)
    seen = judged(cases, calibration)
    seen += [Judged(-1.0, False, o.is_in_map, weight_of(o)) for o in outcomes if o.evidence is None]
    threshold = choose(seen, config.max_false_accept)
    calibration = replace(calibration, min_probability=threshold.min_probability)
    taught = teach_with_prior(with_prior, calibration, config.max_false_accept)
    if taught is not None:
        calibration = replace(calibration, with_prior=taught.calibration)
    simulated = [outcome for outcome in outcomes if not outcome.is_real]
    tested = _queried_places(simulated, calibration, T_level_map)
    bound = bound_of(cases, unanswered=sum(o.evidence is None for o in outcomes))
    told = {**threshold.to_mapping(), "others": [choose(seen, share).to_mapping() for share in TOLD]}
    found = _summary(simulated, calibration, cases, bound, told, grid_of(tested))
    compared = _of_real(found, [o for o in outcomes if o.is_real], calibration, real, of_real)
    found = replace(found, real=compared, with_prior={} if taught is None else taught.report)
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
        places.append(QueriedPlace(here, named, elsewhere[0] if elsewhere else None))
    return places


def _cases(outcomes: Sequence[Outcome], weight_of: Callable[[Outcome], float]) -> list[Case]:
    cases = []
    for outcome in outcomes:
        weight = weight_of(outcome)
        if outcome.evidence is not None:
            right, asked = outcome.right_among_tied, not outcome.is_mirrored
            cases.append(Case(outcome.query, outcome.evidence, right, weight, asked, outcome.is_in_map))
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
    asked = [outcome for outcome in outcomes if not outcome.is_mirrored]
    inside = [outcome for outcome in asked if outcome.T_level_sensor is not None]
    errors = np.array([outcome.first_error_m for outcome in inside])
    accepted = [o for o in asked if o.accepted_by(calibration)]
    return SelfTest(
        queries=len(inside),
        outside=len(asked) - len(inside),
        mirrored=len(outcomes) - len(asked),
        success=_shares(errors),
        among=_shares(np.array([outcome.least_error_m for outcome in inside])),
        localized=_localized(inside, calibration),
        median_error_m=_median(errors),
        false_accepts=sum(not o.right for o in accepted),
        reliability=reliability_of(cases),
        false_accept_bound=bound.to_mapping(),
        threshold=threshold,
        localizability=localizability,
    )


def _of_real(
    found: SelfTest, outcomes: Sequence[Outcome], calibration: Calibration, real: RealScans, weight: float
) -> dict[str, Any]:
    """``SelfTest.real``; empty if the source has no real scans."""
    if not outcomes and not real.left_out and real.of_map is None:
        return {}
    errors = np.array([outcome.first_error_m for outcome in outcomes])
    success, localized = _shares(errors), _localized(outcomes, calibration)
    return {
        "asked": len(outcomes),
        "weight": round(weight, 4),
        "success": success,
        "localized": localized,
        "median_error_m": _median(errors),
        "false_accepts": sum(o.accepted_by(calibration) and not o.right for o in outcomes),
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
    return round(float(np.mean([o.accepted_by(calibration) for o in outcomes])), 4) if outcomes else 0.0


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
