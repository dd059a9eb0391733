"""Comparison of a patched version with the one before, by the same scans at places that have not changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.builds.config import SelfTestConfig
from firstfix.engine.changes.cells import cells_of, keys_of
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, pose_error, transform_points

from ..execution.stage_cache import StageResult
from ..simulation.perturb import ScanCase, ScanSimulation
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator
from .outcome import RIGHT_DEG, RIGHT_M

COMPARED_FILE = "compared.json"
MAX_PLACES = 60
MAX_CHANGED = 0.1  # of the rays of a scan: a place with more has changed
SIGHT_M, STEP_M = 25.0, 0.25
_RAYS = 2000
_TRIES = 4  # cases for each place that is wanted: many see the change


@dataclass(frozen=True)
class Compared:
    """Answers of two versions to the same scans, at places where the map has not changed.

    Attributes:
        places: number of the scans.
        localized_before, localized_after: of these, localized at the right place.
        lost, won: localized at the right place only before, and only after.
        wrong_before, wrong_after: localized at a wrong one.
    """

    places: int
    localized_before: int
    localized_after: int
    lost: int
    won: int
    wrong_before: int
    wrong_after: int

    def to_mapping(self) -> dict[str, int]:
        """JSON values for the version's manifest."""
        return asdict(self)


@dataclass(frozen=True)
class ComparedVersions(StageResult):
    """The result of ``compare`` as a stage."""

    @property
    def record(self) -> dict[str, int]:
        """``Compared`` as JSON values."""
        record: dict[str, int] = json.loads((self.directory / COMPARED_FILE).read_text())
        return record


def compare(
    before: Localizer,
    after: Localizer,
    simulator: Simulator,
    sensor: SensorModel,
    config: SelfTestConfig,
    changed: NDArray[np.int64],
    executor: Executor,
    cancelled: Callable[[], bool],
) -> Compared:
    """Ask both versions.

    Args:
        simulator: mesh of the patched map, levelled frame.
        changed: (n, 3) cells of the map that have changed.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    rng = np.random.default_rng(config.seed)
    simulation = ScanSimulation(simulator, sensor, config.perturb)
    wanted = min(MAX_PLACES, config.queries)
    T_map_level = after.index.T_map_level
    tried = simulation.cases(
        before.index.cascade.templates.position_m, before.index.config.spacing_m, _TRIES * wanted, rng
    )
    keys = keys_of(changed)
    cases: list[ScanCase] = []
    for case in tried:
        if len(cases) < wanted and changed_share(case, simulator, sensor, keys, T_map_level) <= MAX_CHANGED:
            cases.append(case)
    options = LocalizeOptions(T_base_sensor=make_transform(sensor.R_base_sensor, np.zeros(3)))

    def ask(case: ScanCase) -> list[bool | None]:
        if cancelled():
            raise BuildCancelled("cancelled while the patched version was compared")
        scan, T_map_sensor = simulation.scan(case), T_map_level @ case.T_level_sensor
        return [_is_right(each.localize(scan, options), T_map_sensor) for each in (before, after)]

    answers = list(executor.map(ask, cases))
    right = np.array([[one is True for one in pair] for pair in answers], np.bool_).reshape(-1, 2)
    wrong = np.array([[one is False for one in pair] for pair in answers], np.bool_).reshape(-1, 2)
    return Compared(
        places=len(cases),
        localized_before=int(right[:, 0].sum()),
        localized_after=int(right[:, 1].sum()),
        lost=int((right[:, 0] & ~right[:, 1]).sum()),
        won=int((right[:, 1] & ~right[:, 0]).sum()),
        wrong_before=int(wrong[:, 0].sum()),
        wrong_after=int(wrong[:, 1].sum()),
    )


def _is_right(answer: Localization, T_map_sensor: Matrix) -> bool | None:
    """Whether the pose of an answer is right; None: it has no pose."""
    if answer.T_map_sensor is None:
        return None
    error_m, error_deg = pose_error(T_map_sensor, answer.T_map_sensor)
    return error_m <= RIGHT_M and error_deg <= RIGHT_DEG


def changed_share(
    case: ScanCase,
    simulator: Simulator,
    sensor: SensorModel,
    keys: NDArray[np.int64],
    T_map_level: Matrix,
) -> float:
    """0..1, share of a scan's rays that pass through or end in cells of the map with these (n,) keys."""
    rays = Rays.of_sensor(sensor)
    ranges = next(simulator.ranges(case.T_level_sensor[None], sensor, rays))[0]
    chosen = rows_by_chance(len(ranges), _RAYS)
    until_m = np.minimum(np.where(np.isfinite(ranges[chosen]), ranges[chosen], 0), SIGHT_M) + STEP_M
    steps_m = np.arange(STEP_M, SIGHT_M, STEP_M)
    ray, step = np.nonzero(steps_m[None] < until_m[:, None])
    at = rays.directions[chosen[ray]] * steps_m[step, None]
    inside = np.isin(keys_of(cells_of(transform_points(T_map_level @ case.T_level_sensor, at))), keys)
    return len(np.unique(ray[inside])) / max(len(chosen), 1)
