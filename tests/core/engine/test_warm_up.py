"""Scans that a version's own map gives."""

from __future__ import annotations

import numpy as np

from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.warm_up import VIEWPOINTS, own_scans, seen_from
from firstfix.transform import pose_error


def test_own_scans_are_localized_where_they_were_seen(small_version):
    index = MapIndex.load(small_version.directory)
    localizer = Localizer(index)
    for scan in own_scans(index):
        answer = localizer.localize(scan)
        places = np.stack([place.T_map_sensor for place in answer.hypotheses])
        assert np.linalg.norm(places[0, :3, 3] - index.cascade.templates.position_m, axis=1).min() < 0.1


def test_a_scan_seen_from_a_template_gives_its_pose(small_version):
    index = MapIndex.load(small_version.directory)
    position_m = index.cascade.templates.position_m[len(index.cascade.templates) // 2].astype(np.float64)
    T_map_sensor = np.eye(4)
    T_map_sensor[:3, 3] = position_m
    answer = Localizer(index).localize(seen_from(index, position_m))
    assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1


def test_a_surface_hides_what_lies_behind_it(small_version):
    index = MapIndex.load(small_version.directory)
    scan = seen_from(index, np.asarray(index.cascade.templates.position_m[0], np.float64))
    distance_m = np.linalg.norm(scan.points, axis=1)
    azimuth, elevation = (
        np.arctan2(scan.points[:, 1], scan.points[:, 0]),
        np.arcsin(scan.points[:, 2] / distance_m),
    )
    angles = np.degrees(np.stack([azimuth, elevation], axis=1))
    inside = (np.abs(angles - np.round(angles)) > 1e-3).all(axis=1)  # not moved to the next one by float32
    assert np.count_nonzero(inside) > 500
    directions = np.floor(angles[inside])
    assert len(np.unique(directions, axis=0)) == len(directions)


def test_own_scans_are_spread_and_a_small_map_has_few(small_version):
    index = MapIndex.load(small_version.directory)
    assert len(list(own_scans(index))) == VIEWPOINTS
    assert len(list(own_scans(index, 10**6))) == len(index.cascade.templates)
