"""The self-test of a version, before it is published.

Perturbed scans are simulated between the templates, and scans of strange places ship with the release. The
real localizer answers them. The results are the success rate of the version, and the calibration of its
probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.scan.compact import CompactScan
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, make_transform

from ..simulation.perturb import ScanCase, ScanSimulation
from ..simulation.simulate import Simulator
from .alias_leads import alias_tie_width, aliases_among, lead_lost
from .equal_places import equal_places, tie_width
from .localizability import QueriedPlace, grid_of
from .outcome import Outcome
from .prior_asks import MAX, PriorAsks, PriorOutcome, teach_with_prior, worth_a_prior
from .real_scans import RealScans
from .reliability import ABSENT_WEIGHT, Case, bound_of, fit, judged
from .results import SelfTest, queried_places, results_of_real, summary_of
from .strangers import drawn_strangers
from .taught_outcomes import taught_outcomes
from .threshold import TOLD, Judged, choose


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
    """Run the test in the index's levelled frame; the localizer's own T_map_level is undone.

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
            lost = None if simulation is rough else lead_lost(localizer, simulation, case, asked_with)
            outcome = Outcome.here(number, answer, case.T_level_sensor, T_map_level)
            aliases = aliases_among(localizer.index, answer)
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
        aliases = aliases_among(localizer.index, answer)
        ticked()
        return replace(outcome, aliases=aliases, is_real=True)

    def ticked() -> None:
        nonlocal done
        done += 1
        progress(min(1.0, done / (len(queries) + len(real.scans) + MAX)))

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

    asked_again = worth_a_prior([outcome for outcome in outcomes if not outcome.is_real], rng)
    with_prior = [one for several in executor.map(run_with_prior, asked_again) for one in several]
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
    tested = queried_places(simulated, calibration, T_level_map)
    bound = bound_of(cases, unanswered=sum(o.evidence is None for o in outcomes))
    others = [choose(seen, share, taught.ceiling(share)).to_mapping() for share in TOLD]
    told = {**threshold.to_mapping(), "others": others, "taught": taught.to_mapping()}
    found = summary_of(simulated, calibration, cases, bound, told, grid_of(tested))
    compared = results_of_real(found, [o for o in outcomes if o.is_real], calibration, real, of_real)
    found = replace(found, real=compared, with_prior={} if of_priors is None else of_priors.report)
    return found, calibration, bound, tested


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
