"""Order in which sessions are placed, and their map. Another test has their alignment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.errors import BuildFailed
from firstfix.transform import inverse, make_transform, rotation_z, transform_points
from firstfix_builder.mesh.intensity import Intensity
from firstfix_builder.sources.sessions import merge as merge_module
from firstfix_builder.sources.sessions.description import Session
from firstfix_builder.sources.sessions.merge import ReadSession, merge
from firstfix_builder.sources.sessions.place_session import NotPlaced, Placement

T = [make_transform(rotation_z(n), [10.0 * n, n, 0.1 * n]) for n in range(4)]  # T_first_session, the truth


def read(number, given=None, T_session_level=None):
    rows = None if given is None else tuple(map(tuple, given.tolist()))
    points = np.random.default_rng(number).uniform(-5, 5, (20 + number, 3))
    level = np.eye(4) if T_session_level is None else T_session_level
    return ReadSession(Session(source=f"s{number}.pcd", T_map_session=rows), points, None, level)


@pytest.fixture
def overlaps(monkeypatch):
    """Says which sessions overlap, and records who was tried with whom."""
    pairs, tried = set(), []

    def place(session, placed, executor, cancelled):
        tried.append((session, tuple(one.session for one in placed)))
        if any((session, one.session) in pairs or (one.session, session) in pairs for one in placed):
            return Placement(T[session], {"overlap": 0.3})
        return NotPlaced("too little overlap: 3 of 48")

    monkeypatch.setattr(merge_module, "place_session", place)
    return pairs, tried


def merged(sessions, placed_one=lambda: None):
    return merge(sessions, lambda number: number, None, None, placed_one, lambda: False)


def test_a_session_that_finds_no_place_is_tried_again_after_others(overlaps):
    pairs, tried = overlaps
    pairs |= {(0, 2), (2, 1)}
    found = merged([read(0), read(1), read(2)])
    assert tried == [(1, (0,)), (2, (0,)), (1, (0, 2))]
    for number, entry in enumerate(found.record):
        np.testing.assert_allclose(entry["T_map_session"], T[number], atol=1e-6)
        assert entry["source"] == f"s{number}.pcd"
    assert [entry["aligned"] for entry in found.record] == [False, True, True]
    assert len(found.points) == 63


def test_those_that_fit_nowhere_are_named(overlaps):
    pairs, _ = overlaps
    pairs |= {(0, 1)}
    with pytest.raises(BuildFailed, match=r"session s2\.pcd cannot be placed: too little.*s3\.pcd cannot"):
        merged([read(n) for n in range(4)])


def test_a_given_transform_is_kept_as_it_is(overlaps):
    _, tried = overlaps
    level = [
        make_transform(rotation_z(0.0), [500_000.0, 4_000_000.0, 0.0]),
        make_transform(rotation_z(1), [3, 2, 1]),
    ]
    given = make_transform(rotation_z(-0.7), [500_123.0, 4_000_456.0, 7.0])
    sessions = [read(0, T_session_level=level[0]), read(1, given, level[1])]
    found = merged(sessions)
    assert not tried
    np.testing.assert_allclose(found.record[1]["T_map_session"], given, atol=1e-6)
    np.testing.assert_array_equal(found.points[:20], sessions[0].points)
    expected = transform_points(inverse(level[0]) @ given @ level[1], sessions[1].points)
    np.testing.assert_allclose(found.points[20:], expected, atol=1e-6)
    np.testing.assert_allclose(found.T_map_first, level[0])


def test_the_first_session_may_have_a_transform_too(overlaps):
    pairs, _ = overlaps
    pairs |= {(0, 1)}
    given = make_transform(rotation_z(0.4), [100.0, 50.0, 0])
    found = merged([read(0, given), read(1)])
    np.testing.assert_allclose(found.record[0]["T_map_session"], given, atol=1e-6)
    np.testing.assert_allclose(found.record[1]["T_map_session"], given @ T[1], atol=1e-6)


def test_trajectories_are_laid_into_the_map(overlaps):
    pairs, _ = overlaps
    pairs |= {(0, 1)}
    poses = np.stack([make_transform(np.eye(3), [x, 0.0, 1.0]) for x in range(3)])
    first = read(0)
    first = ReadSession(first.session, first.points, poses, first.T_session_level)
    found = merged([first, read(1)])
    np.testing.assert_allclose(found.trajectory, poses)
    assert merged([read(0), read(1)]).trajectory is None


def test_points_that_a_later_session_saw_through_take_their_intensity_along(overlaps, monkeypatch):
    pairs, _ = overlaps
    pairs |= {(0, 1)}
    gone = np.arange(20) % 3 == 0
    monkeypatch.setattr(merge_module, "seen_through", lambda cloud, simulator, trajectory: gone)
    poses = np.stack([np.eye(4)])
    bright = [Intensity(np.arange(n, dtype=np.uint8), 0.0, 255.0) for n in (20, 21)]
    sessions = [
        replace(read(0), intensity=bright[0]),
        replace(read(1), trajectory=poses, intensity=bright[1]),
    ]
    found = merge(sessions, lambda number: number, lambda number: None, None, lambda: None, lambda: False)
    assert found.intensity is not None
    np.testing.assert_array_equal(found.intensity.values[:13], np.arange(20)[~gone])
    np.testing.assert_array_equal(found.points[:13], sessions[0].points[~gone])
    np.testing.assert_array_equal(found.intensity.values[13:], np.arange(21))


def test_each_session_that_is_placed_is_told(overlaps):
    pairs, _ = overlaps
    pairs |= {(0, 2), (2, 1)}
    told = []
    merged([read(0), read(1), read(2)], lambda: told.append(1))
    assert len(told) == 2
