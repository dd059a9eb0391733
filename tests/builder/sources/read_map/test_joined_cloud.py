"""Scans joined in voxels as they come: the same as all of them at once, within bounds."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, TooLarge
from firstfix_builder.mesh.clean_cloud import voxel_means
from firstfix_builder.sources.read_map import joined_cloud
from firstfix_builder.sources.read_map.joined_cloud import JoinedCloud
from firstfix_builder.sources.read_map.map_limits import MapLimits

RNG = np.random.default_rng(2)
SCANS = [RNG.uniform(-3, 3, (400, 3)) for _ in range(12)]


@pytest.mark.parametrize("fold_rows", [1, 1000, 10**6])
def test_the_means_are_of_all_points_whenever_they_are_joined(fold_rows: int, monkeypatch):
    monkeypatch.setattr(joined_cloud, "FIRST_FOLD_ROWS", fold_rows)
    cloud = JoinedCloud(0.5, 10**6)
    for scan in SCANS:
        cloud.add(scan)
    np.testing.assert_allclose(cloud.points(), voxel_means(np.concatenate(SCANS), 0.5), atol=1e-12)
    assert cloud.voxel_m == 0.5


def test_the_intensity_is_a_mean_too_and_changes_no_point(monkeypatch):
    monkeypatch.setattr(joined_cloud, "FIRST_FOLD_ROWS", 1000)
    plain, bright, lacking = (JoinedCloud(0.5, 10**6) for _ in range(3))
    for number, scan in enumerate(SCANS):
        plain.add(scan)
        bright.add(scan, scan[:, 0])
        lacking.add(scan, None if number == 7 else scan[:, 0])
    found = bright.intensity()
    assert found is not None
    np.testing.assert_allclose(found, bright.points()[:, 0], atol=1e-12)
    assert plain.intensity() is None
    assert lacking.intensity() is None
    assert plain.points().tobytes() == bright.points().tobytes() == lacking.points().tobytes()


def test_voxels_grow_until_the_points_are_few_enough(monkeypatch):
    monkeypatch.setattr(joined_cloud, "FIRST_FOLD_ROWS", 1)
    cloud = JoinedCloud(0.05, 500)
    for scan in SCANS:
        cloud.add(scan)
        assert len(cloud.points()) <= 500
    assert 0.5 < cloud.voxel_m < 2.0
    assert len(cloud.points()) > 200


def test_beyond_the_limits_it_says_so(monkeypatch):
    monkeypatch.setattr(joined_cloud, "LIMITS", MapLimits(1000, 10**9))
    cloud = JoinedCloud(0.01, 10**6)
    for scan in SCANS:
        cloud.add(scan)
    with pytest.raises(TooLarge, match="mapping scans"):
        cloud.points()


def test_scans_of_different_planets_are_no_map():
    cloud = JoinedCloud(0.05, 10**6)
    cloud.add(SCANS[0])
    cloud.add(SCANS[1] + 1e8)
    with pytest.raises(MalformedData, match="too far apart"):
        cloud.points()


def test_a_cloud_of_no_scans_is_empty():
    cloud = JoinedCloud(0.1, 100)
    assert cloud.points().shape == (0, 3)
    cloud.add(np.empty((0, 3)))
    assert cloud.points().shape == (0, 3)
