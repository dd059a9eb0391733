"""A version with the trajectory of its mapping run knows which space was seen free."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.verification.seen_free import SEEN_FREE_FILE
from firstfix.errors import CorruptVersion
from firstfix.transform import make_transform
from firstfix_builder.pipeline import build_version
from small_world import COARSE_CONFIG

pytestmark = pytest.mark.slow


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


def test_a_pose_through_seen_free_space_is_told_from_the_true_one(version, small_scans):
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


def test_a_version_without_a_trajectory_does_not_know(coarse_version, small_scans):
    index = MapIndex.load(coarse_version.directory)
    assert index.seen_free is None
    found = Localizer(index).localize(small_scans[0][0]).hypotheses
    assert found
    assert {one.quality.seen_free for one in found if one.quality} == {None}


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
