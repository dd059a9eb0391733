"""Perturbed scans: where they are taken, what stands in their way, and that a seed says all."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.builds.config import PerturbConfig
from firstfix.sensor import SensorModel, preset
from firstfix.transform import rotation_angle_deg
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.box_scenes import box

SENSOR = SensorModel("ring-3", (-10.0, 0.0, 10.0), 1.0, 0.3, 60.0, 0.8)
CLEAN = PerturbConfig(noise_m=0, dropout=0, occluders=0, strangers=0, unmapped=0, vanished=0)
REACH_M = 2.0


def room() -> Simulator:
    walls = box((-9, -7, 0), (9, 7, 3))
    return Simulator(walls.vertices, walls.triangles)


def cases(config: PerturbConfig, count: int = 200, around=((0, 0, 0.8), (8.9, 0, 0.8))):
    simulation = ScanSimulation(room(), SENSOR, config)
    return simulation, simulation.cases(np.array(around), REACH_M, count, np.random.default_rng(1))


def test_spots_are_free_and_near_the_places():
    simulation, found = cases(PerturbConfig())
    assert len(found) == 200
    spots = np.array([case.T_level_sensor[:3, 3] for case in found])
    assert simulation.simulator.distance(spots).min() >= 0.3 - 1e-5
    off = np.minimum(np.abs(spots[:, 0]), np.abs(spots[:, 0] - 8.9))
    assert off.max() <= REACH_M / 2
    assert (spots[:, 0] > 5).sum() > 20  # half of the spots around it are outside of the wall
    assert np.abs(spots[:, 0]).max() < 9  # where the map is not
    assert len({case.seed for case in found}) == 200
    tilts = [rotation_angle_deg(case.T_level_sensor[:3, :3]) for case in found]
    assert np.ptp(tilts) > 90  # any heading


def test_there_are_fewer_cases_where_no_spot_is_free():
    simulation = ScanSimulation(room(), SENSOR, CLEAN)
    nowhere = simulation.cases(np.array([[9.0, 7.0, 0.0]]), 0.1, 5, np.random.default_rng(0))
    assert nowhere == []


def test_a_clean_scan_lies_on_the_walls():
    simulation, found = cases(CLEAN, 5)
    for case in found:
        T = case.T_level_sensor
        points = simulation.scan(case).points @ T[:3, :3].T + T[:3, 3]
        off = np.abs(
            np.stack([np.abs(points[:, 0]) - 9, np.abs(points[:, 1]) - 7, np.abs(points[:, 2] - 1.5) - 1.5])
        )
        assert off.min(axis=0).max() < 1e-4


def test_a_case_gives_the_same_scan_in_any_order():
    simulation, found = cases(PerturbConfig(), 6)
    scans = [simulation.scan(case).points for case in found]
    again = [simulation.scan(case).points for case in reversed(found)]
    assert all(np.array_equal(one, other) for one, other in zip(scans, reversed(again), strict=True))
    assert len({len(scan) for scan in scans}) > 1


def test_a_mid_360_scans_at_any_moment_of_its_pattern():
    simulation = ScanSimulation(room(), preset("mid-360"), CLEAN)
    found = simulation.cases(np.array([[0, 0, 0.8]]), REACH_M, 12, np.random.default_rng(1))
    here = found[0].T_level_sensor
    scans = [simulation.scan(replace(case, T_level_sensor=here)).points for case in found]
    assert len({scan.tobytes() for scan in scans}) > 4


def test_noise_and_dropout_are_as_large_as_asked():
    simulation, found = cases(CLEAN.model_copy(update={"noise_m": 0.05, "dropout": 0.3}), 12)
    clean = ScanSimulation(simulation.simulator, SENSOR, CLEAN)
    kept, off = [], []
    for case in found:
        noisy, exact = simulation.scan(case).points, clean.scan(case).points
        kept.append(len(noisy) / len(exact))
        along = noisy / np.linalg.norm(noisy, axis=1, keepdims=True)
        row = (along @ (exact / np.linalg.norm(exact, axis=1, keepdims=True)).T).argmax(axis=1)
        off.append(np.linalg.norm(noisy, axis=1) - np.linalg.norm(exact[row], axis=1))
    assert np.mean(kept) == pytest.approx(0.7, abs=0.02)
    assert np.std(np.concatenate(off)) == pytest.approx(0.05, rel=0.05)


def test_a_lost_return_does_not_come_back_beyond_a_wall():
    """A passer-by further away than the wall stops no ray, not even one whose return is lost."""
    crowd = CLEAN.model_copy(update={"occluders": 8.0, "strangers": 4.0, "dropout": 0.5})
    simulation, found = cases(crowd, 40, ((0, 0, 0.8),))
    for case in found:
        T = case.T_level_sensor
        points = simulation.scan(case).points @ T[:3, :3].T + T[:3, 3]
        assert (np.abs(points[:, :2]) < [9.01, 7.01]).all()
        assert (np.abs(points[:, 2] - 1.5) < 1.51).all()


def test_what_stands_in_the_way_stops_rays_at_every_azimuth():
    """Also where the azimuth jumps from 180 to -180 degrees."""
    simulation, found = cases(
        CLEAN.model_copy(update={"occluders": 8.0, "strangers": 4.0}), 150, ((0, 0, 0.8),)
    )
    clean = ScanSimulation(simulation.simulator, SENSOR, CLEAN)
    stopped = np.zeros((150, 360), bool)
    for number, case in enumerate(found):
        seen, free = (
            np.linalg.norm(one.scan(case).points, axis=1).reshape(3, 360) for one in (simulation, clean)
        )
        assert (seen <= free + 1e-4).all()
        stopped[number] = seen[1] < free[1] - 1e-3  # the level beam
    share = stopped.mean(axis=0)
    assert share.min() > 0.05
    assert share.max() < 3 * share.min()
    begins = stopped & ~np.roll(stopped, 1, axis=1)
    assert (stopped[:, 0] & stopped[:, -1]).any()  # one thing, seen on both sides of the jump
    assert begins.sum() > 150


@pytest.mark.parametrize("config", [CLEAN, PerturbConfig(), PerturbConfig(unmapped=0, vanished=0)])
def test_a_scan_of_given_clean_ranges_is_the_same_and_leaves_them_as_they_are(config: PerturbConfig):
    simulation, found = cases(config, 3)
    for case in found:
        clean = simulation.clean_ranges(case)
        kept = clean.copy()
        np.testing.assert_array_equal(simulation.scan(case, clean=clean).points, simulation.scan(case).points)
        np.testing.assert_array_equal(clean, kept)
