"""The scans of a case, and where they were taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firstfix.engine.index import MapIndex
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, transform_points
from firstfix_builder.simulation.perturb import elsewhere, perturbed_scans
from firstfix_builder.simulation.simulate import Simulator

from ...common.worlds import Scenery, WorldFiles
from .cases import Case

Query = tuple[Scan, Matrix | None]  # T_map_sensor, None: not of this map
SCANS_PER_YARD = 20
YARD_M = 15.0  # of a strange yard's middle


def queries_of(
    case: Case,
    index: MapIndex,
    sensor: SensorModel,
    files: WorldFiles,
    others: Sequence[Scenery],
    count: int,
    rng: np.random.Generator,
) -> list[Query]:
    """At most ``count``; none where the world has no scenery for the case.

    Args:
        others: places outside the map.
    """
    if case.where == "own queries":
        return files.own_queries()[:count]
    if case.where == "strange yard":
        return _in_yards(case, sensor, count, rng)
    if case.where == "other worlds":
        return _abroad(case, sensor, others, count, rng)
    if case.where == "look-alikes":
        return _abroad(case, sensor, files.look_alikes, count, rng)
    scenery = files.map if case.where == "map" else files.changed
    if scenery is None:
        return []
    templates = index.cascade.templates
    at_m = transform_points(index.T_map_level, templates.position_m)
    if case.own_height:
        at_m[:, 2] += sensor.mount_height_m - templates.height_m
    spacing_m = index.config.spacing_m
    return list(perturbed_scans(scenery.simulator(), sensor, at_m, spacing_m, count, case.perturb, rng))


def _in_yards(case: Case, sensor: SensorModel, count: int, rng: np.random.Generator) -> list[Query]:
    found: list[Query] = []
    for start in range(0, count, SCANS_PER_YARD):
        yard, wanted = Simulator(*elsewhere(rng)), min(SCANS_PER_YARD, count - start)
        at_m = np.column_stack([rng.uniform(-YARD_M, YARD_M, (200, 2)), np.full(200, sensor.mount_height_m)])
        scans = perturbed_scans(yard, sensor, at_m, 1.0, wanted, case.perturb, rng)
        found += [(scan, None) for scan, _ in scans]
    return found


def _abroad(
    case: Case, sensor: SensorModel, places: Sequence[Scenery], count: int, rng: np.random.Generator
) -> list[Query]:
    """Scans of other worlds, the same number in each."""
    found: list[Query] = []
    for scenery, share in zip(places, np.array_split(np.arange(count), max(1, len(places))), strict=False):
        simulator = scenery.simulator()
        at_m = scenery.viewpoints(simulator, sensor.mount_height_m)
        scans = perturbed_scans(simulator, sensor, at_m, 1.0, len(share), case.perturb, rng)
        found += [(scan, None) for scan, _ in scans]
    return found
