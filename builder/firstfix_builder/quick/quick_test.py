"""The self-test of a provisional version: a few scans between its templates, and real ones of the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.warm_up import seen_from
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, rotation_z

from ..self_test.enough import Ended
from ..self_test.outcome import Outcome
from ..self_test.reliability import CrossValidated
from ..self_test.results import SelfTest, summary_of
from ..self_test.threshold import Judged, choose
from ..sources.read_map.held_out import HeldOutScan
from .quick_index import QuickPlaces
from .sensor_view import SensorView

SCANS, REAL_SCANS = 12, 12
HIDDEN, HIDDEN_DEG = 3, 20.0  # sectors that passers-by hide, and the width of each


@dataclass(frozen=True)
class QuickTested:
    """Results of the self-test of a provisional version.

    Attributes:
        calibration: the prior's, with a threshold above every wrong place that the test saw.
        bound: of false accepts, by the places that were wrong.
    """

    calibration: Calibration
    bound: FalseAcceptBound
    report: SelfTest


def quick_test(
    localizer: Localizer,
    held_out: Sequence[HeldOutScan],
    places: QuickPlaces,
    config: BuildConfig,
    threads: Executor,
) -> QuickTested:
    """Ask the version some scans. All of them are made again by the same seed.

    The scans have the map's own points, so they fit better than a robot's. So they never make an answer surer
    than the prior does: they can only raise the threshold.

    Args:
        localizer: of the version, with the prior as its calibration.
        held_out: real scans that are not among the map's points, with T_level_sensor.
    """
    rng = np.random.default_rng(config.self_test.seed)
    sensor, level = config.sensor_model, localizer.index.T_map_level
    asked_with = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))

    def here(scan: Scan | CompactScan, T_level_sensor: Matrix, *, is_real: bool) -> _Ask:
        def judge(number: int, answer: Localization) -> Outcome:
            return replace(Outcome.here(number, answer, T_level_sensor, level), is_real=is_real)

        return _Ask(scan, judge)

    asks = []
    for T_level_sensor in _between(places, min(SCANS, config.self_test.queries), sensor.R_base_sensor, rng):
        asks.append(here(_scan(localizer.index, T_level_sensor, sensor, rng), T_level_sensor, is_real=False))
    for row in rows_by_chance(len(held_out), min(REAL_SCANS, len(held_out))):
        asks.append(here(held_out[row].scan, held_out[row].T_sensor, is_real=True))

    def outcome_of(number: int) -> Outcome:
        return asks[number].judge(number, localizer.localize(asks[number].scan, asked_with))

    return judged(list(threads.map(outcome_of, range(len(asks)))), config)


@dataclass(frozen=True)
class _Ask:
    scan: Scan | CompactScan
    judge: Callable[[int, Localization], Outcome]


def judged(outcomes: Sequence[Outcome], config: BuildConfig) -> QuickTested:
    """The results of some outcomes: the prior, whose threshold no wrong place of them reaches."""
    prior = Calibration()
    seen = [Judged(-1.0, False, o.is_in_map) for o in outcomes if o.evidence is None]
    for outcome in outcomes:
        for evidence, right, asked in (
            (outcome.evidence, outcome.right_among_tied, True),
            (outcome.without_the_truth, False, False),
        ):
            if evidence is not None:
                claimed = prior.probability(evidence) if prior.accepts(evidence, 0.0) else -1.0
                seen.append(Judged(claimed, right, outcome.is_in_map and asked, asked=asked))
    threshold = choose(seen, config.self_test.max_false_accept, None)
    least = max(threshold.min_probability, prior.min_probability)
    calibration = replace(prior, min_probability=least, search_until=least)
    bound = FalseAcceptBound.of([case.claimed for case in seen if not case.right])
    told = {**replace(threshold, min_probability=least).to_mapping(), "others": []}
    unchecked = CrossValidated((), (), ())  # nothing is fitted
    ended = Ended(len(outcomes), 1.0, (), is_decided=False).to_mapping()
    return QuickTested(
        calibration, bound, summary_of(outcomes, calibration, unchecked, bound, told, [], ended)
    )


def _between(
    places: QuickPlaces, count: int, R_base_sensor: NDArray[np.float64], rng: np.random.Generator
) -> Iterator[Matrix]:
    """Yield T_level_sensor somewhere around ``count`` templates, up to half of their spacing away."""
    for row in rng.integers(len(places.at), size=count):
        beside_m = np.append(rng.uniform(-0.5, 0.5, 2) * places.spacing_m, 0.0)
        yield make_transform(
            rotation_z(rng.uniform(-np.pi, np.pi)) @ R_base_sensor, places.at[row] + beside_m
        )


def _scan(index: MapIndex, T_level_sensor: Matrix, sensor: SensorModel, rng: np.random.Generator) -> Scan:
    """The scan that a sensor would take: the points that no nearer one hides, noise, and passers-by."""
    around = seen_from(index, T_level_sensor[:3, 3]).points
    seen = SensorView.of(sensor).seen(np.ascontiguousarray(around, np.float32))
    azimuth_deg = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    for middle_deg in rng.uniform(-180, 180, HIDDEN):
        away_deg = np.abs((azimuth_deg - middle_deg + 180) % 360 - 180)
        seen, azimuth_deg = (values[away_deg > HIDDEN_DEG / 2] for values in (seen, azimuth_deg))
    range_m = np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), sensor.min_range_m)
    seen = seen * (1 + sensor.range_noise_m * rng.standard_normal((len(seen), 1)) / range_m)
    return Scan.from_points(seen @ T_level_sensor[:3, :3])
