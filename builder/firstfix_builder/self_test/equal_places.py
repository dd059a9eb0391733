"""Equal places of a map, such as those of two storeys of one plan: how unequally does a scan fit them?

No matcher can tell them apart. But their surfaces were sampled from different viewpoints, so a scan fits one
a little better than the other. Poses whose support differs by no more than that must tie.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import RankingConfig
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, pose_error

from ..simulation.rays import Rays
from ..simulation.simulate import Simulator

_ALIKE_M, _ALIKE_SHARE = 0.1, 0.02  # of ranges: what is nearer is the same surface
EQUAL = 0.97  # share of rays; more that meet the same: the places are equal
_COMPARED_RAYS, _MIN_RAYS = 2000, 100
_LEVEL_M = 0.2  # nearer to the floor or the ceiling, a surface tells no places apart
_FOUND_M, _FOUND_DEG = 0.2, 2.0  # from the true pose
_ELSEWHERE_M = 1.0
_COMPARED = 3  # rivals of one scan that are no equals: more will hardly be
_TIE, _MIN_SCANS = 0.95, 20  # share of the equal places that tie, and scans of such places to learn it from


def tie_width(unequal: Sequence[float | None], asked: float = 1.0) -> float:
    """Difference of support below which poses of a map tie, from its scans' ``EqualPlaces.unequal_by``.

    So wide that all but one in twenty equal places tie. Of few equal places nothing is learned.

    Args:
        asked: 0..1, share of the planned scans that these are.
    """
    found = [by for by in unequal if by is not None]
    if len(found) < _MIN_SCANS * asked:
        return Calibration().min_margin
    most = float(np.quantile(found, _TIE, method="lower"))
    return max(Calibration().min_margin, math.floor(most * 1e4 + 1) / 1e4)


@dataclass(frozen=True)
class EqualPlaces:
    """Places among the hypotheses of one scan's answer that are equal to the true one.

    Attributes:
        numbers: of the hypotheses.
        unequal_by: largest difference of support between the true place and one of them; None: there is none.
    """

    numbers: tuple[int, ...] = ()
    unequal_by: float | None = None


NO_EQUALS = EqualPlaces()


def equal_places(
    answer: Localization,
    simulator: Simulator,
    sensor: SensorModel,
    T_level_sensor: Matrix,
    T_level_map: Matrix,
    ranking: RankingConfig,
) -> EqualPlaces:
    """Look for equals of the true place among its rivals, the closest in support first.

    None are found if the true place was not.

    Args:
        T_level_sensor: (4, 4) where the scan was taken.
    """
    poses = [
        (number, ranking.support(one.quality), T_level_map @ one.T_map_sensor)
        for number, one in enumerate(answer.hypotheses)
        if one.quality is not None
    ]
    off = [pose_error(T_level_sensor, T) for _, _, T in poses]
    true = next((n for n, (m, deg) in enumerate(off) if m < _FOUND_M and deg < _FOUND_DEG), None)
    if true is None:
        return NO_EQUALS
    own = poses[true][1]
    rivals = [
        (abs(support - own), number, T)
        for (number, support, T), (off_m, _) in zip(poses, off, strict=True)
        if off_m > _ELSEWHERE_M and abs(support - own) < ranking.max_margin
    ]
    equal: dict[int, float] = {}
    others = 0
    for by, number, T in sorted(rivals, key=lambda rival: rival[0]):
        if share_seen_alike(simulator, sensor, T_level_sensor, T) > EQUAL:
            equal[number] = by
        else:
            others += 1
        if others == _COMPARED:
            break
    return EqualPlaces(tuple(sorted(equal)), max(equal.values(), default=None))


def share_seen_alike(
    simulator: Simulator,
    sensor: SensorModel,
    T_level_one: Matrix,
    T_level_other: Matrix,
) -> float:
    """Share of a sensor's rays, 0..1, that meet the same at two poses. 0 if there are too few to tell.

    Floor and ceiling do not count: they are the same in every room.
    """
    rays = Rays.of_sensor(sensor).directions
    some = Rays.of(rays[np.random.default_rng(len(rays)).integers(len(rays), size=_COMPARED_RAYS)])
    own = next(simulator.ranges(T_level_one[None], sensor, some))[0]
    found = next(simulator.ranges(T_level_other[None], sensor, some))[0]
    height_m = some.turned(T_level_one).directions[:, 2] * own
    met = np.isfinite(own)
    if not met.any():
        return 0.0
    floor_m, ceiling_m = np.percentile(height_m[met], [5, 95])
    tells = met & (height_m > floor_m + _LEVEL_M) & (height_m < ceiling_m - _LEVEL_M)
    same = np.abs(own[tells] - found[tells]) < _ALIKE_M + _ALIKE_SHARE * own[tells]
    return float(same.mean()) if len(same) >= _MIN_RAYS else 0.0
