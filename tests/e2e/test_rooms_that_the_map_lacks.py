"""Two rooms of one plan above each other: the mapping run drove into the upper one and past the lower one."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.builds.config import PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, pose_error
from firstfix_builder.simulation.moving import Motion, Sweep
from firstfix_builder.simulation.perturb import ScanCase, ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SENSOR, SmallWorld
from tests.storey_world import CONFIG, SENSOR_Z, STOREY_M, Box, mesh_of, pose, raised

CORRIDOR: list[Box] = [
    ((2.5, 3.6, -0.1), (15, 2.2, 0.2)),
    ((2.5, 4.8, 1.4), (15, 0.2, 2.8)),
    ((-5, 3.6, 1.4), (0.2, 2.2, 2.8)),
    ((10, 3.6, 1.4), (0.2, 2.2, 2.8)),
    ((-4, 2.6, 1.4), (2, 0.2, 2.8)),
    ((6.5, 2.6, 1.4), (7, 0.2, 2.8)),
    ((7, 4.5, 0.5), (1, 0.4, 1.0)),
]
SEEN_FROM_THE_DOOR: list[Box] = [
    ((0, 1.9, -0.1), (6.2, 1.4, 0.2)),
    ((0, -2.6, 1.4), (6.2, 0.2, 2.8)),
    ((-3, 0, 1.4), (0.2, 5.2, 2.8)),
    ((-0.75, 2.6, 1.4), (4.5, 0.2, 2.8)),
    ((2.75, 2.6, 1.4), (0.5, 0.2, 2.8)),
]
NOT_SEEN: list[Box] = [
    ((0, -0.7, -0.1), (6.2, 3.8, 0.2)),
    ((3, 0, 1.4), (0.2, 5.2, 2.8)),
    ((-2.4, -1.2, 0.9), (0.8, 1.6, 1.8)),
    ((0.6, -2.2, 0.6), (1.8, 0.5, 1.2)),
    ((-2.5, 1.8, 0.5), (0.6, 0.9, 1.0)),
    ((2.5, -0.4, 0.7), (0.5, 1.0, 1.4)),
]
UPSTAIRS: list[Box] = [*NOT_SEEN[:-1], ((2.4, -1.6, 0.7), (0.6, 1.0, 1.4)), ((-1, 1.0, 0.4), (0.5, 0.5, 0.8))]
CALM = PerturbConfig(occluders=0, strangers=0, unmapped=0, vanished=0, tilt_deg=0, height_m=0)
TURNS_RAD_S = {"rest": 0.0, "turning": 1.3}


def building(lower: list[Box]) -> SmallWorld:
    upper = raised(mesh_of([*CORRIDOR, *SEEN_FROM_THE_DOOR, *UPSTAIRS]))
    roof = raised(mesh_of([((2.5, 1.2, -0.1), (15.2, 7.8, 0.2))]), 2 * STOREY_M)
    parts = [mesh_of([*CORRIDOR, *lower]), upper, roof]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=False)]
    return SmallWorld(np.concatenate([part.vertices for part in parts]), np.concatenate(triangles))


@pytest.fixture(scope="module")
def localizer(once_a_run) -> Localizer:
    built = once_a_run.version(
        "half_mapped", lambda folder: building(SEEN_FROM_THE_DOOR).write(folder / "map.ply"), CONFIG
    )
    return Localizer(MapIndex.load(built.directory), explains=False)


@pytest.fixture(scope="module")
def simulation() -> ScanSimulation:
    there = building([*SEEN_FROM_THE_DOOR, *NOT_SEEN])
    return ScanSimulation(Simulator(there.vertices, there.triangles), SensorModel.from_mapping(SENSOR), CALM)


def answers(
    localizer: Localizer, simulation: ScanSimulation, motion: str
) -> list[tuple[Localization, np.ndarray]]:
    """The answers of scans in the lower room, each with T_map_sensor."""
    moving = Motion((0.0, 0.0, 0.0, 0.0, 0.0, TURNS_RAD_S[motion]), Sweep())
    found = []
    for number in range(5):
        T = pose(-0.4 + 0.4 * number, 1.4 + 0.2 * (number % 3), 40 * number)
        scan = simulation.scan(ScanCase(T, number, None), moving)
        found.append((localizer.localize(scan), T))
    return found


@pytest.mark.parametrize("motion", TURNS_RAD_S)
def test_a_scan_of_the_lower_room_is_not_placed_in_the_upper_one(localizer, simulation, motion):
    """It fits the upper room far better, and contradicts nothing in the lower one."""
    for answer, T in answers(localizer, simulation, motion):
        assert answer.verdict is Verdict.AMBIGUOUS
        assert any(pose_error(T, one.T_map_sensor)[0] < 0.5 for one in answer.hypotheses)


def test_a_scan_of_the_upper_room_is_localized(localizer, simulation):
    """It fits all that stands there: no scan of the lower room would."""
    upstairs = make_transform(np.eye(3), [0.4, 1.5, STOREY_M + SENSOR_Z])
    scan = simulation.scan(ScanCase(upstairs, 3, None), Motion((0.0,) * 6, Sweep()))
    answer = localizer.localize(scan)
    assert answer.verdict is Verdict.LOCALIZED
    assert pose_error(upstairs, answer.T_map_sensor)[0] < 0.1
