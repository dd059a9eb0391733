"""Sessions of a simulated building through the first stage of a build, against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.errors import BuildFailed, InvalidOption, MalformedData
from firstfix.transform import inverse, rotation_angle_deg, transform_points
from tests.builder.sources.sessions.building import Building, Session, building, session
from tests.builder.sources.sessions.merged_sessions import (
    ENDS_M,
    FROM_M,
    HERE,
    described,
    first_session,
    read_map,
    sparser_session,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # sessions are aligned

TWIN = building(21, things=5)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """Stages of all tests here: the first session is always the same one."""
    return tmp_path_factory.mktemp("work")


@pytest.fixture(scope="module")
def first():
    return first_session()


def errors(files: Path, sessions: list[Session], place: Building) -> tuple[float, float]:
    """Largest error at the building's corners in metres, and of the heading in degrees."""
    record = json.loads((files / "sessions.json").read_text())
    T, T_true = np.array(record[1]["T_map_session"]), truth(sessions)
    corners = transform_points(inverse(sessions[1].T_world_session), place.corners)
    off = np.linalg.norm(transform_points(T, corners) - transform_points(T_true, corners), axis=1)
    return float(off.max()), rotation_angle_deg(T_true[:3, :3].T @ T[:3, :3])


def truth(sessions: list[Session]) -> np.ndarray:
    return inverse(sessions[0].T_world_session) @ sessions[1].T_world_session


@pytest.mark.parametrize(
    "second",
    [sparser_session, lambda: session(building(21, moved=0.3), FROM_M, 32.0, seed=2)],
    ids=["sparser", "moved"],
)
def test_two_halves_are_aligned(tmp_path, work, first, second):
    sessions = [first, second()]
    files = read_map(described(tmp_path, sessions), work)
    off_m, off_deg = errors(files, sessions, HERE)
    assert off_m < 0.05
    assert off_deg < 0.2
    [_, placed] = json.loads((files / "sessions.json").read_text())
    assert placed["aligned"]
    assert 5 <= placed["evidence"]["places_agreeing"] <= placed["evidence"]["places_asked"]
    whole = transform_points(
        inverse(sessions[0].T_world_session), HERE.corners
    )  # the map is in the first session's frame
    T_map_level = np.load(files / "T_map_level.npy")
    points = transform_points(T_map_level, np.load(files / "points.npy"))
    assert np.all(points.min(axis=0) < whole.min(axis=0) + 1.5)
    assert np.all(points.max(axis=0) > whole.max(axis=0) - 1.5)
    assert np.quantile(cKDTree(points).query(sessions[0].cloud)[0], 0.9) < 0.1, "in its file's coordinates"
    assert len(np.load(files / "trajectory.npy")) == sum(len(one.trajectory) for one in sessions)


def test_what_was_moved_is_left_out_where_the_later_session_saw_through(tmp_path, work, first):
    sessions = [first, session(building(21, moved=0.3), FROM_M, 32.0, seed=2)]
    files = read_map(described(tmp_path, sessions), work)
    earlier, later = json.loads((files / "sessions.json").read_text())
    assert earlier["removed_points"] > 100
    assert later["removed_points"] == 0
    kept = read_map(described(tmp_path / "same", [first, session(HERE, FROM_M, 32.0, seed=2)]), work)
    assert (
        json.loads((kept / "sessions.json").read_text())[0]["removed_points"] < earlier["removed_points"] / 5
    )


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (lambda: session(HERE, 23.0, 32.0, seed=3), "too little overlap|ambiguous|looks alike"),
        (lambda: session(building(22), *ENDS_M, seed=4), "too little overlap|ambiguous|looks alike"),
        (lambda: session(TWIN, *ENDS_M, seed=5), "looks alike, such as another storey"),
    ],
    ids=["no overlap", "another building", "the storey above"],
)
def test_sessions_of_two_places_are_not_merged(tmp_path, work, first, other, why):
    with pytest.raises(BuildFailed, match=rf"session s1/cloud\.npy cannot be placed: .*({why})"):
        read_map(described(tmp_path, [first, other()]), work)


def test_a_bent_session_is_refused_with_the_place(tmp_path, work, first):
    bent = session(HERE, 0.0, 24.0, seed=6, bend_deg=6.0, at_home=True)
    with pytest.raises(BuildFailed, match=r"bent: .* places are off, most at \(.*\) m by 0\.\d+ m"):
        read_map(described(tmp_path, [first, bent]), work)


def test_trajectories_stand_in_the_description(tmp_path, work, first):
    folder = described(tmp_path, [first])
    with pytest.raises(InvalidOption, match="trajectories of several sessions"):
        read_map(folder, work, folder / "s0/poses.txt")


def test_a_damaged_session_is_named(tmp_path, work, first):
    folder = described(tmp_path, [first, first])
    (folder / "s1/cloud.npy").write_bytes(b"damaged")
    with pytest.raises(MalformedData, match=r"session s1/cloud\.npy: cloud\.npy: "):
        read_map(folder, work)


def test_a_mesh_is_no_session(tmp_path, work, first):
    folder = described(tmp_path, [first])
    (folder / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    (folder / "sessions.yaml").write_text(
        json.dumps({"sessions": [{"source": "s0/cloud.npy"}, {"source": "wall.obj"}]})
    )
    with pytest.raises(MalformedData, match=r"session wall\.obj: it is a mesh"):
        read_map(folder, work)
