"""A building of two equal storeys: nobody can tell which one a scan is of, and the answer says just that."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
import pytest

from firstfix.answer.localization import Reason, Verdict
from firstfix.builds.config import BuildConfig, PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.sensor import SensorModel
from firstfix.transform import pose_error
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.box_scenes import box
from tests.small_world import SENSOR

pytestmark = pytest.mark.slow

STOREY_M = 3.0
CONFIG = {
    "sensor": {**SENSOR, "azimuth_step_deg": 2.4},
    "learn_keys": {"scans": 60},
    "self_test": {"queries": 30, "outside": 10},
}


def building() -> Mesh:
    """Two storeys of 8 by 6 m, furnished alike, and a roof."""
    storey = [
        box((0, 0, -0.2), (8, 6, 0)),
        box((-0.2, 0, -0.2), (0, 6, STOREY_M)),
        box((8, 0, -0.2), (8.2, 6, STOREY_M)),
        box((0, -0.2, -0.2), (8, 0, STOREY_M)),
        box((0, 6, -0.2), (8, 6.2, STOREY_M)),
        box((0.2, 0.2, 0), (0.8, 2.6, 1.9)),
        box((3.5, 0, 0), (5.5, 0.7, 0.8)),
        box((6.9, 3.4, 0), (7.8, 5.2, 1.2)),
        box((2.2, 3.6, 0), (3.1, 4.4, 2.3)),
    ]
    roof = box((0, 0, 2 * STOREY_M - 0.2), (8, 6, 2 * STOREY_M))
    return reduce(_joined, [*storey, *(_lifted(part) for part in storey), roof])


def _lifted(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices + np.array([0, 0, STOREY_M]), mesh.triangles)


def _joined(one: Mesh, other: Mesh) -> Mesh:
    triangles = np.concatenate([one.triangles, add(other.triangles, len(one.vertices))])
    return Mesh(np.concatenate([one.vertices, other.vertices]), triangles)


@pytest.fixture(scope="module")
def version(tmp_path_factory: pytest.TempPathFactory) -> BuildResult:
    import trimesh

    folder, mesh = tmp_path_factory.mktemp("storeys"), building()
    trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(folder / "building.ply")
    return build_version(folder / "building.ply", BuildConfig.parse(CONFIG), folder / "work")


def test_every_answer_is_ambiguous_and_holds_the_true_place(version: BuildResult):
    index, mesh = MapIndex.load(version.directory), building()
    position_m = index.cascade.templates.position_m
    assert (position_m[:, 2] < STOREY_M).sum() == (position_m[:, 2] > STOREY_M).sum() > 0
    scans = perturbed_scans(
        Simulator(mesh.vertices, mesh.triangles),
        SensorModel.from_mapping(CONFIG["sensor"]),
        position_m,
        1.0,
        50,
        PerturbConfig(strangers=0, unmapped=0, vanished=0),  # nothing of a car's size comes into a room
        np.random.default_rng(5),
    )
    localizer = Localizer(index)
    answers = [(localizer.localize(scan), index.T_map_level @ T) for scan, T in scans]
    assert {(a.verdict, a.reasons) for a, _ in answers} == {(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))}
    among_two = [
        any(pose_error(truth, one.T_map_sensor)[0] < 0.5 for one in answer.hypotheses[:2])
        for answer, truth in answers
    ]
    assert np.mean(among_two) >= 0.95
    for answer, _ in answers:
        first, second = answer.hypotheses[:2]
        assert first.probability == second.probability == answer.probability / 2


def test_the_self_test_does_not_take_equal_places_for_errors(version: BuildResult):
    assert version.manifest.self_test["among"]["0.5m"] >= 0.9
    assert version.manifest.self_test["localized"] == 0.0
    assert version.manifest.self_test["reliability"]["expected_calibration_error"] < 0.2
