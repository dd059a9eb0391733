"""Before a version is published: can a robot find itself with it, and does it know when not?

Held-out, disturbed scans simulated between the templates, and scans of a place that is not in the
map, go through the real localizer. The outcome is the version's own success rate and the calibration
of its probabilities (design: a figure nobody measured on this map is not promised).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from firstfix.build_config import SelfTestConfig
from firstfix.calibration import Calibration
from firstfix.errors import BuildCancelled
from firstfix.evidence import Evidence, evidence
from firstfix.localization import Localization
from firstfix.localizer import Localizer
from firstfix.options import LocalizeOptions
from firstfix.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse, make_transform, pose_error

from .disturb import disturbed_scans, elsewhere
from .localizability import Spot, grid_of
from .reliability import Case, fit, reliability_of
from .simulate import Simulator

RIGHT_M, RIGHT_DEG = 1.0, 10.0  # further off than this, a fix is a false one
ABSENT_BEYOND_M = 3.0  # from the true place: what is nearer would not be in the map without it either
ABSENT_WEIGHT = 0.25  # robots are mostly where their map is


@dataclass(frozen=True)
class SelfTest:
    """What came out, over ``queries`` disturbed scans in the map and ``outside`` from elsewhere.

    Attributes:
        success: "0.2m" and so on to the share of the queries whose best hypothesis is that near.
        localized: share of the queries answered ``localized``.
        false_accepts: answers ``localized`` that were wrong by over 1 m or 10 degrees, or outside.
        reliability: ``reliability.reliability_of`` all of them.
        localizability: ``localizability.grid_of`` the queries.
    """

    queries: int
    outside: int
    success: dict[str, float]
    localized: float
    median_error_m: float
    false_accepts: int
    reliability: dict[str, Any]
    localizability: list[dict[str, object]]

    def to_mapping(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class _Outcome:
    """Attributes:
    T_level_sensor: (4, 4) where the scan was taken, or None: elsewhere.
    error_m, error_deg: of the best hypothesis, infinite where there is none.
    """

    answer: Localization
    T_level_sensor: Matrix | None
    error_m: float
    error_deg: float

    @property
    def right(self) -> bool:
        return self.error_m <= RIGHT_M and self.error_deg <= RIGHT_DEG

    @property
    def evidence(self) -> Evidence | None:
        fits = [h.fit for h in self.answer.hypotheses if h.fit is not None]
        return evidence(fits) if fits else None

    def accepted_by(self, calibration: Calibration) -> bool:
        """Whether the calibrated localizer would call this localized."""
        found = self.evidence
        return found is not None and calibration.accepts(found)

    @property
    def without_the_truth(self) -> Evidence | None:
        """What would have been found had the true place not been in the map: a hard negative.

        A map's own look-alikes teach more than scans of a strange place: the next aisle of a hall
        explains four fifths of a scan.
        """
        if not self.right:
            return None
        here = self.answer.hypotheses[0].T_map_sensor
        elsewhere = [
            h.fit
            for h in self.answer.hypotheses[1:]
            if h.fit is not None and pose_error(here, h.T_map_sensor)[0] > ABSENT_BEYOND_M
        ]
        return evidence(elsewhere) if len(elsewhere) > 1 else None  # of one alone the margin is not known


def self_test(
    localizer: Localizer,
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> tuple[SelfTest, Calibration, list[Spot]]:
    """Runs the test in the index's levelled frame; the localizer's own T_map_level is undone.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    rng = np.random.default_rng(config.seed)
    templates = localizer.index.cascade.templates
    inside = disturbed_scans(
        simulator,
        sensor,
        templates.position_m,
        localizer.index.config.spacing_m,
        config.queries,
        config.disturb,
        rng,
    )
    other = Simulator(*elsewhere(rng))
    spots = np.column_stack(
        [rng.uniform(-15, 15, (200, 2)), np.full(200, float(np.median(templates.height_m)))]
    )
    outside = disturbed_scans(other, sensor, spots, 1.0, config.outside, config.disturb, rng)
    queries: list[tuple[Scan, Matrix | None]] = [*inside, *((scan, None) for scan, _ in outside)]
    asked_with = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))
    done = 0

    def run(query: tuple[Scan, Matrix | None]) -> _Outcome:
        nonlocal done
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        scan, T_level_sensor = query
        answer = localizer.localize(scan, asked_with)
        done += 1
        progress(done / len(queries))
        if T_level_sensor is None or not answer.hypotheses:
            return _Outcome(answer, T_level_sensor, np.inf, np.inf)
        T_map_sensor = localizer.index.T_map_level @ T_level_sensor
        error = pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)
        return _Outcome(answer, T_level_sensor, *error)

    outcomes = list(executor.map(run, queries))
    cases = _cases(outcomes)
    calibration = fit(cases)
    tested = _spots(outcomes, calibration, inverse(localizer.index.T_map_level))
    return _summary(outcomes, calibration, reliability_of(cases), grid_of(tested)), calibration, tested


def _spots(outcomes: Sequence[_Outcome], calibration: Calibration, T_level_map: Matrix) -> list[Spot]:
    """The queries in the map, each with the place elsewhere that it resembles most."""
    spots = []
    for outcome in outcomes:
        if outcome.T_level_sensor is None:
            continue
        here = outcome.T_level_sensor[:3, 3]
        found = [(T_level_map @ h.T_map_sensor)[:3, 3] for h in outcome.answer.hypotheses]
        elsewhere = [at for at in found if np.linalg.norm(at - here) > RIGHT_M]
        accepted = outcome.accepted_by(calibration)
        named = ("localized" if outcome.right else "wrong") if accepted else "unsure"
        spots.append(Spot(here, named, elsewhere[0] if elsewhere else None))
    return spots


def _cases(outcomes: Sequence[_Outcome]) -> list[Case]:
    cases = []
    for query, outcome in enumerate(outcomes):
        if outcome.evidence is not None:
            cases.append(Case(query, outcome.evidence, outcome.right))
        if outcome.without_the_truth is not None:
            cases.append(Case(query, outcome.without_the_truth, False, ABSENT_WEIGHT, asked=False))
    return cases


def _summary(
    outcomes: Sequence[_Outcome],
    calibration: Calibration,
    reliability: dict[str, Any],
    localizability: list[dict[str, object]],
) -> SelfTest:
    inside = [outcome for outcome in outcomes if outcome.T_level_sensor is not None]
    errors = np.array([o.error_m if o.error_deg <= RIGHT_DEG else np.inf for o in inside])
    accepted = [o for o in outcomes if o.accepted_by(calibration)]
    return SelfTest(
        queries=len(inside),
        outside=len(outcomes) - len(inside),
        success={
            f"{limit}m": round(float(np.mean(errors <= limit)), 4) if len(errors) else 0.0
            for limit in (0.05, 0.2, 0.5, 1)
        },
        localized=round(float(np.mean([o.accepted_by(calibration) for o in inside])), 4) if inside else 0.0,
        median_error_m=round(float(np.median(errors)), 4)
        if len(errors) and np.isfinite(np.median(errors))
        else -1.0,
        false_accepts=sum(not o.right for o in accepted),
        reliability=reliability,
        localizability=localizability,
    )
