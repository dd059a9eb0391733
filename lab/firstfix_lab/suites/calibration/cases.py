"""Cases to which the prior is fitted: scans of known origin, and the places that the engine finds there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import MAX_RADIUS_M, Prior
from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import PerturbConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.localizer import Localizer
from firstfix.engine.ranking import RANKING
from firstfix.scan.scan import Scan
from firstfix.sensor import preset
from firstfix.transform import Matrix, pose_error, transform_points
from firstfix_builder.simulation.perturb import elsewhere, perturbed_scans
from firstfix_builder.simulation.simulate import Simulator

from ...common.worlds import BenchWorld, WorldFiles

SEED = 77  # not that of the robust suite
RIGHT_M, RIGHT_DEG = 1.0, 10.0
ABSENT_BEYOND_M = 3.0  # from the true place: what is nearer would not be in the map without it either
YARDS, YARD_M = 3, 15.0
LOOK_ALIKE = "look-alike"
# Maps and scans of real scanners agree less well than simulated ones do: a part of the scans is rougher.
PERTURBATIONS = (PerturbConfig(), PerturbConfig(noise_m=0.06, occluders=12, strangers=6))


@dataclass(frozen=True)
class Place:
    """A pose that the engine found.

    Attributes:
        right: whether the scan was taken there.
    """

    quality: AlignmentQuality
    right: bool


@dataclass(frozen=True)
class Case:
    """One query.

    Attributes:
        kind: "inside" the map; "absent", the same scan as if the map lacked its place; "alike", of another
            place of the same kind; or "outside".
        places: ranked, best first.
    """

    world: str
    scenery: str
    kind: str
    places: tuple[Place, ...]


class ElsewherePrior(Prior):
    """Allows all poses but those near some places. It is a prior, so that the engine searches as always.

    Args:
        T_map_sensor: (k, 4, 4) poses that must not be found.
    """

    def __init__(self, T_map_sensor: NDArray[np.float64]) -> None:
        super().__init__(T_map_sensor[0, :3, 3], MAX_RADIUS_M)
        object.__setattr__(self, "_absent_m", T_map_sensor[:, :3, 3])

    def allows_each(
        self, T_map_sensor: NDArray[np.float64], slack_m: float = 0.0, slack_deg: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether each of (k, 4, 4) poses lies elsewhere. A candidate not yet aligned is allowed."""
        if slack_m:
            return np.ones(len(T_map_sensor), bool)
        away = T_map_sensor[:, None, :3, 3] - self._absent_m  # type: ignore[attr-defined]
        far: NDArray[np.bool_] = (np.linalg.norm(away, axis=2) > ABSENT_BEYOND_M).all(axis=1)
        return far


def cases_of(world: BenchWorld, files: WorldFiles, localizer: Localizer, scans: int) -> list[Case]:
    """The cases of one world.

    Args:
        scans: in each scenery and with each of PERTURBATIONS; as many are of a look-alike, and half as many
            of strange yards.
    """
    cases = []
    for scenery, scan, T_map_sensor in _scans(world, files, localizer, scans):
        if T_map_sensor is None:
            kind = "alike" if scenery == LOOK_ALIKE else "outside"
            cases.append(Case(world.name, scenery, kind, _found(localizer, scan, None, None)[0]))
            continue
        places, equals = _found(localizer, scan, T_map_sensor, None)
        cases.append(Case(world.name, scenery, "inside", places))
        if equals is not None:
            others, _ = _found(localizer, scan, None, ElsewherePrior(equals))
            cases.append(Case(world.name, scenery, "absent", others))
    return cases


def _scans(
    world: BenchWorld, files: WorldFiles, localizer: Localizer, count: int
) -> Iterator[tuple[str, Scan, Matrix | None]]:
    rng = np.random.default_rng([SEED, crc32(world.name.encode())])
    sensor, index = preset(world.config["sensor"]), localizer.index
    at_m = transform_points(index.T_map_level, index.cascade.templates.position_m)
    sceneries = {"as mapped": files.map, "another day": files.changed, "emptied": files.emptied}
    for name, scenery in sceneries.items():
        if scenery is None:
            continue
        simulator = scenery.simulator()
        for perturb in PERTURBATIONS:
            for scan, T in perturbed_scans(simulator, sensor, at_m, 1.0, count, perturb, rng):
                yield name, scan, T
    for look_alike in files.look_alikes:
        simulator = look_alike.simulator()
        there_m = look_alike.viewpoints(simulator, sensor.mount_height_m)
        for perturb in PERTURBATIONS:
            for scan, _ in perturbed_scans(simulator, sensor, there_m, 1.0, count, perturb, rng):
                yield LOOK_ALIKE, scan, None
    spots = np.column_stack([rng.uniform(-YARD_M, YARD_M, (200, 2)), np.full(200, sensor.mount_height_m)])
    for wanted in np.diff(np.linspace(0, count // 2, YARDS + 1).astype(int)).tolist():
        yard = Simulator(*elsewhere(rng))
        for scan, _ in perturbed_scans(yard, sensor, spots, 1.0, wanted, PERTURBATIONS[0], rng):
            yield "strange yard", scan, None


def _found(
    localizer: Localizer, scan: Scan, T_map_sensor: Matrix | None, prior: Prior | None
) -> tuple[tuple[Place, ...], NDArray[np.float64] | None]:
    """The places that the engine finds, and the poses of the right one and of those that tie with it.

    The poses are None if the right place was not found: then its equals are not known.
    """
    hypotheses = localizer.localize(scan, LocalizeOptions(prior=prior)).hypotheses
    places = tuple(
        Place(one.quality, T_map_sensor is not None and _is_right(T_map_sensor, one.T_map_sensor))
        for one in hypotheses
        if one.quality is not None
    )
    true = next((RANKING.support(place.quality) for place in places if place.right), None)
    if true is None:
        return places, None
    least = true - Calibration().min_margin
    equals = [
        one.T_map_sensor
        for one, place in zip(hypotheses, places, strict=True)
        if place.right or RANKING.support(place.quality) > least
    ]
    return places, np.array(equals)


def _is_right(T_true: Matrix, T_found: Matrix) -> bool:
    error_m, error_deg = pose_error(T_true, T_found)
    return error_m <= RIGHT_M and error_deg <= RIGHT_DEG
