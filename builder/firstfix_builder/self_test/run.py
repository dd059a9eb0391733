"""Before a version is published: can a robot find itself with it, and does it know when not?

Held-out, perturbed scans simulated between the templates, and scans of a place that is not in the
map, go through the real localizer. The outcome is the version's own success rate and the calibration
of its probabilities (design: a figure nobody measured on this map is not promised).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality, MatchFeatures
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse, make_transform, pose_error

from ..simulation.perturb import ScanCase, ScanSimulation, elsewhere
from ..simulation.simulate import Simulator
from .localizability import Spot, grid_of
from .reliability import Case, fit, reliability_of

RIGHT_M, RIGHT_DEG = 1.0, 10.0  # further off than this, a fix is a false one
ABSENT_BEYOND_M = 3.0  # from the true place: what is nearer would not be in the map without it either
ABSENT_WEIGHT = 0.25  # robots are mostly where their map is
LIMITS_M = (0.05, 0.2, 0.5, 1)
_UNFITTED = Calibration()  # says which places tie; fitting does not change that


@dataclass(frozen=True)
class SelfTest:
    """Results of ``queries`` perturbed scans in the map and ``outside`` scans from elsewhere.

    Attributes:
        success: "0.2m" and so on to the share of the queries whose best hypothesis is that near.
        among: the same of any hypothesis: the place was found, whether or not it was ranked first.
        localized: share of the queries answered ``localized``.
        false_accepts: answers ``localized`` that were wrong by over 1 m or 10 degrees, or outside.
        reliability: ``reliability.reliability_of`` all of them.
        localizability: ``localizability.grid_of`` the queries.
    """

    queries: int
    outside: int
    success: dict[str, float]
    among: dict[str, float]
    localized: float
    median_error_m: float
    false_accepts: int
    reliability: dict[str, Any]
    localizability: list[dict[str, object]]

    def to_mapping(self) -> dict[str, Any]:
        """Returns the results as JSON values."""
        return asdict(self)


@dataclass(frozen=True)
class _Outcome:
    """One query and its answer.

    Attributes:
        T_level_sensor: (4, 4) where the scan was taken, or None: elsewhere.
        errors_m: of each hypothesis in turn; infinite where it is turned by over RIGHT_DEG too.
    """

    answer: Localization
    T_level_sensor: Matrix | None
    errors_m: tuple[float, ...]

    @property
    def first_error_m(self) -> float:
        """Error of the best hypothesis, infinite if there is none."""
        return self.errors_m[0] if self.errors_m else np.inf

    @property
    def least_error_m(self) -> float:
        """Least error of all hypotheses, infinite if there are none."""
        return min(self.errors_m, default=np.inf)

    @property
    def right(self) -> bool:
        return self.first_error_m <= RIGHT_M

    @property
    def evidence(self) -> MatchFeatures | None:
        return _UNFITTED.match_features(self._fits) if self._fits else None

    @property
    def right_among_tied(self) -> bool:
        """Returns whether the best hypothesis is right, or one that ties with it."""
        found = self.evidence
        return found is not None and min(self.errors_m[: found.tied]) <= RIGHT_M

    def accepted_by(self, calibration: Calibration) -> bool:
        """Returns whether the calibrated localizer would call this localized."""
        found = self.evidence
        return found is not None and calibration.accepts(found)

    @property
    def without_the_truth(self) -> MatchFeatures | None:
        """A hard negative: the evidence if neither the true place nor its equals were in the map.

        A map's own look-alikes teach more than scans of a strange place: the next aisle of a hall explains
        four fifths of a scan. An equal of the true place teaches nothing: nobody could tell that it is wrong.
        """
        found = self.evidence
        if found is None or not self.right_among_tied:
            return None
        tied, others = self.answer.hypotheses[: found.tied], self.answer.hypotheses[found.tied :]
        elsewhere = [
            other.quality
            for other in others
            if other.quality is not None
            and all(pose_error(one.T_map_sensor, other.T_map_sensor)[0] > ABSENT_BEYOND_M for one in tied)
        ]
        # of one alone the margin is not known
        return _UNFITTED.match_features(elsewhere) if len(elsewhere) > 1 else None

    @property
    def _fits(self) -> list[AlignmentQuality]:
        return [h.quality for h in self.answer.hypotheses if h.quality is not None]


def run_self_test(
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
    here = ScanSimulation(simulator, sensor, config.perturb)
    inside = here.cases(templates.position_m, localizer.index.config.spacing_m, config.queries, rng)
    strange = ScanSimulation(Simulator(*elsewhere(rng)), sensor, config.perturb)
    spots = np.column_stack(
        [rng.uniform(-15, 15, (200, 2)), np.full(200, float(np.median(templates.height_m)))]
    )
    outside = strange.cases(spots, 1.0, config.outside, rng)
    queries = [*((here, case) for case in inside), *((strange, case) for case in outside)]
    asked_with = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))
    done = 0

    def run(query: tuple[ScanSimulation, ScanCase]) -> _Outcome:
        nonlocal done
        if cancelled():
            raise BuildCancelled("cancelled during the self-test")
        simulation, case = query
        answer = localizer.localize(simulation.scan(case), asked_with)
        done += 1
        progress(done / len(queries))
        if simulation is strange:
            return _Outcome(answer, None, (np.inf,) * len(answer.hypotheses))
        T_map_sensor = localizer.index.T_map_level @ case.T_level_sensor
        errors = [pose_error(T_map_sensor, one.T_map_sensor) for one in answer.hypotheses]
        return _Outcome(
            answer,
            case.T_level_sensor,
            tuple(error_m if error_deg <= RIGHT_DEG else np.inf for error_m, error_deg in errors),
        )

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
            cases.append(Case(query, outcome.evidence, outcome.right_among_tied))
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
    errors = np.array([outcome.first_error_m for outcome in inside])
    accepted = [o for o in outcomes if o.accepted_by(calibration)]
    return SelfTest(
        queries=len(inside),
        outside=len(outcomes) - len(inside),
        success=_shares(errors),
        among=_shares(np.array([outcome.least_error_m for outcome in inside])),
        localized=round(float(np.mean([o.accepted_by(calibration) for o in inside])), 4) if inside else 0.0,
        median_error_m=round(float(np.median(errors)), 4)
        if len(errors) and np.isfinite(np.median(errors))
        else -1.0,
        false_accepts=sum(not o.right for o in accepted),
        reliability=reliability,
        localizability=localizability,
    )


def _shares(errors_m: NDArray[np.float64]) -> dict[str, float]:
    """The share of the errors within each limit."""
    return {
        f"{limit}m": round(float(np.mean(errors_m <= limit)), 4) if len(errors_m) else 0.0
        for limit in LIMITS_M
    }
