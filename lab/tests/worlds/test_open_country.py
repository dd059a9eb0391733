"""Scans of sloping fields, where surfaces mislead the estimate of up: the place is found all the same."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.sensor import SensorModel
from firstfix.transform import pose_error
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.write_world import ply_of_mesh
from firstfix_lab.worlds.farm import farm
from tests.small_world import SENSOR

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # a version of a farm is built

CORNER_M, SIDE_M = np.array([2.0, -62.0]), 64.0  # of the part of the farm that is mapped
CONFIG = {
    "sensor": {**SENSOR, "azimuth_step_deg": 1.2},
    "viewpoints": {"spacing_m": 1.5},
    "learn_keys": {"scans": 0},
    "self_test": {"queries": 12, "outside": 6},
}
SHAKEN = PerturbConfig(noise_m=0.02, dropout=0.1, occluders=8, strangers=0, height_m=0.05, tilt_deg=5)


def part_of_the_farm() -> Mesh:
    whole = farm(np.random.default_rng(7)).mesh()
    corners = whole.vertices[whole.triangles][:, :, :2]
    inside = ((corners > CORNER_M) & (corners < CORNER_M + SIDE_M)).all(axis=(1, 2))
    return whole.with_triangles(inside)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return part_of_the_farm()


@pytest.fixture(scope="module")
def localizer(mesh, once_a_run) -> Localizer:
    def write(folder):
        (folder / "farm.ply").write_bytes(ply_of_mesh(mesh))
        return folder / "farm.ply"

    return Localizer(MapIndex.load(once_a_run.version("open-country", write, CONFIG).directory))


@pytest.fixture(scope="module")
def scans(mesh, localizer):
    simulator, sensor = Simulator(mesh.vertices, mesh.triangles), SensorModel.from_mapping(CONFIG["sensor"])
    around_m = localizer.index.cascade.templates.position_m
    return perturbed_scans(simulator, sensor, around_m, 1.5, 60, SHAKEN, np.random.default_rng(3))


def found(localizer, scans, options=None) -> int:
    count = 0
    for scan, T_map_sensor in scans:
        hypotheses = localizer.localize(scan, options).hypotheses
        off_m, off_deg = pose_error(T_map_sensor, hypotheses[0].T_map_sensor) if hypotheses else (99, 99)
        count += off_m < 1 and off_deg < 10
    return count


def test_nearly_every_place_is_found(localizer, scans):
    assert len(scans) == 60
    assert found(localizer, scans) >= 52  # by the surfaces' up alone 39


def test_a_gravity_that_the_surfaces_confirm_is_searched_by_alone(localizer, scans):
    """Also where no place explains the scan, and there is no other up to try."""
    gravity = [(scan, T, LocalizeOptions(gravity=T[:3, :3].T @ [0, 0, -9.8])) for scan, T in scans[:20]]
    assert sum(found(localizer, [(scan, T)], options) for scan, T, options in gravity) >= 18
