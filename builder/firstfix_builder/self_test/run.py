"""The self-test of a version, before it is published.

Perturbed scans are simulated between the templates, and scans of strange places ship with the release. The
real localizer answers them, round by round, until what they decide is decided (``enough``). The results are
the success rate of the version, and the calibration of its probabilities.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from firstfix.builds.config import ActivateConfig, SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.transform import inverse

from ..simulation.simulate import Simulator
from .asks import Asked, Asks, Query, SimulatedScan, count_of, planned_rounds
from .enough import FIRST_LOOK, OF_THE_MAP, ROUNDS, Ended, are_steady, still_open
from .lesson import Lesson, tie_widths
from .localizability import QueriedPlace, grid_of
from .outcome import Outcome
from .prior_asks import MAX, PriorAsks, PriorOutcome, WorthAPrior, teach_with_prior
from .real_scans import RealScans
from .results import SelfTest, queried_places, results_of_real, summary_of


def run_self_test(
    localizer: Localizer,
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    activate: ActivateConfig,
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
    rounds = planned_rounds(localizer, simulator, sensor, config, rng)
    planned, asks, worth = count_of(rounds), Asks(localizer, simulator, sensor), WorthAPrior(rng)
    priors = PriorAsks(localizer, simulator, sensor, asks.options, config.seed)
    done = 0

    def ticked() -> None:
        nonlocal done
        done += 1
        progress(min(1.0, done / (planned + len(real.scans) + MAX)))
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")

    def run(query: Query) -> Asked:
        asked = asks.ask(query)
        ticked()
        return asked

    def run_real(number: int) -> Outcome:
        outcome = asks.ask_real(real, number, planned)
        ticked()
        return outcome

    def run_with_prior(asked: Asked) -> list[PriorOutcome]:
        found = priors.outcomes(asked.outcome, asked.scan)
        ticked()
        return found

    of_real = list(executor.map(run_real, range(len(real.scans))))
    free: list[Outcome] = []
    with_prior: list[PriorOutcome] = []
    opened: tuple[str, ...] = ()
    ranking = localizer.index.config.ranking
    widths: list[tuple[float, float]] = []
    for number, queries in enumerate(rounds, 1):
        if config.until_decided and opened and OF_THE_MAP.issuperset(opened):
            queries = [one for one in queries if isinstance(one.of, SimulatedScan)]
            worth.is_enough = True
        several = list(executor.map(run, queries))
        free += [one.outcome for one in several]
        share = len(free) / planned if planned else 1.0
        again = worth.of(several, share)
        with_prior += [one for found in executor.map(run_with_prior, again) for one in found]
        widths.append(tie_widths([*free, *of_real], ranking, share))
        if number < FIRST_LOOK:
            continue
        weight = real.weight(sum(one.is_in_map for one in free))
        lesson = Lesson.of([*free, *of_real], weight, ranking, config, share)
        if number == ROUNDS:
            break
        now_open = _open(lesson, activate, are_ties_settled=are_steady(widths))
        if config.until_decided and not now_open:
            break
        opened = now_open
    ended = Ended(planned, share, opened, is_decided=number < ROUNDS)
    calibration = lesson.calibration
    of_priors = teach_with_prior(with_prior, calibration, config.max_false_accept)
    if of_priors is not None:
        calibration = replace(calibration, with_prior=of_priors.calibration)
    T_level_map = inverse(localizer.index.T_map_level)
    tested = queried_places(lesson.simulated, calibration, T_level_map)
    bound = lesson.bound()
    found = summary_of(
        lesson.simulated,
        calibration,
        lesson.checked,
        bound,
        lesson.threshold,
        grid_of(tested),
        ended.to_mapping(),
    )
    compared = results_of_real(found, [o for o in lesson.outcomes if o.is_real], calibration, real, weight)
    found = replace(found, real=compared, with_prior={} if of_priors is None else of_priors.report)
    return found, calibration, bound, tested


def _open(lesson: Lesson, activate: ActivateConfig, *, are_ties_settled: bool) -> tuple[str, ...]:
    inside = [one for one in lesson.simulated if one.is_in_map]
    return still_open(
        inside,
        lesson.calibration,
        activate,
        is_threshold_settled=lesson.is_settled,
        are_ties_settled=are_ties_settled,
    )
