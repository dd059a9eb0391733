"""A version with the trajectory of its mapping run knows which space was seen free."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import BuildConfig
from firstfix.engine.changes.cells import CELL_M, cells_of_keys
from firstfix.engine.changes.sighting import sighting_of
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.verification.seen_free import SEEN_FREE_FILE
from firstfix.errors import CorruptVersion
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from tests.changed_hall import standing
from tests.small_world import COARSE_CONFIG, SENSOR


@pytest.fixture(scope="module")
def version(small_map, tmp_path_factory):
    """The yard, mapped by a drive along its middle."""
    folder = tmp_path_factory.mktemp("seen-free")
    rows = [f"{k} {x:.2f} {y} 0.8 0 0 0 1" for k, (x, y) in enumerate(drive())]
    (folder / "drive.txt").write_text("\n".join(rows) + "\n")
    return build_version(
        small_map, BuildConfig.parse(COARSE_CONFIG), folder / "work", trajectory=folder / "drive.txt"
    ).directory


def drive() -> list[tuple[float, float]]:
    return [(x, y) for y in (-4.0, -1.5, 1.0) for x in np.arange(-7, 7.1, 0.5).tolist()]


def test_a_pose_through_seen_free_space_has_a_larger_share_in_it(version, small_scans):
    index = MapIndex.load(version)
    assert index.seen_free is not None
    moved = make_transform(np.eye(3), [1.5, 1.0, 0.0])
    for scan, T_map_sensor in small_scans[:6]:
        T_level_sensor = np.linalg.inv(index.T_map_level) @ T_map_sensor
        poses = np.array([T_level_sensor, moved @ T_level_sensor])
        here, beside = index.seen_free.shares(np.ascontiguousarray(scan.points, np.float32), poses)
        assert beside > here + 0.05


def test_an_answer_says_how_much_of_the_scan_lies_in_seen_free_space(version, small_scans):
    first = Localizer(MapIndex.load(version)).localize(small_scans[0][0]).hypotheses[0]
    assert first.quality is not None
    assert 0 <= first.quality.seen_free < 0.1


def test_a_share_in_seen_free_space_lowers_the_rank(version):
    ranking, clean = MapIndex.load(version).config.ranking, AlignmentQuality(0.9, 0.8, 0.0, 0.0)
    supports = [ranking.support(replace(clean, seen_free=share)) for share in (None, 0.0, 0.02, 0.1, 0.3)]
    assert supports[0] == supports[1]
    assert supports[1:] == sorted(supports[1:], reverse=True)


def test_a_thing_that_has_come_is_new_and_no_part_that_was_never_mapped(version, small_world):
    index, rng = MapIndex.load(version), np.random.default_rng(4)
    low, high = np.array([0.2, -2.4, 0.0]), np.array([1.2, -1.4, 1.4])  # on the way of the drive
    thing = standing((*low, *high)).mesh()
    vertices = np.concatenate([small_world.vertices, thing[0]])
    triangles = np.concatenate([small_world.triangles, thing[1] + len(small_world.vertices)])
    now, sensor = Simulator(vertices, triangles), SensorModel.from_mapping(SENSOR)
    rays, on_it, unmapped = Rays.of_sensor(sensor), 0, 0
    for x, y in drive():
        T_map_sensor = make_transform(np.eye(3), [x, y, 0.8])
        if not now.is_free(T_map_sensor[None, :3, 3], 0.4)[0]:
            continue
        ranges = next(now.ranges(T_map_sensor[None], sensor, rays))[0] + rng.normal(
            0, 0.02, len(rays.directions)
        )
        seen = np.isfinite(ranges)
        scan = Scan.from_points(rays.directions[seen] * ranges[seen, None])
        told = sighting_of(index, scan, T_map_sensor)
        assert told.knows_coverage
        for_it = [cells_of_keys(keys) * CELL_M for keys in (told.unexplained, told.unmapped)]
        here = [((at > low - 0.6) & (at < high + 0.1)).all(axis=1).sum() for at in for_it]
        on_it, unmapped = on_it + here[0], unmapped + here[1]
    assert on_it > 40
    assert unmapped < 0.05 * on_it


def test_a_version_without_a_trajectory_has_no_seen_free_space(coarse_version, small_scans):
    index = MapIndex.load(coarse_version.directory)
    assert index.seen_free is None
    found = Localizer(index).localize(small_scans[0][0]).hypotheses
    assert found
    assert {one.quality.seen_free for one in found if one.quality} == {None}
    told = sighting_of(index, *small_scans[0])
    assert (told.knows_coverage, len(told.unmapped)) == (False, 0)


@pytest.mark.parametrize(
    "damage", [lambda body: body[:-40], lambda body: b"\xff" * len(body), lambda body: b""]
)
def test_a_damaged_file_refuses_the_version(version, tmp_path, damage):
    folder = tmp_path / "version"
    shutil.copytree(version, folder)
    body = (folder / SEEN_FREE_FILE).read_bytes()
    (folder / SEEN_FREE_FILE).write_bytes(damage(body))
    with pytest.raises(CorruptVersion):
        MapIndex.load(folder)
