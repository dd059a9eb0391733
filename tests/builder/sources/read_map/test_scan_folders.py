"""Scans that SLAM programs leave: those of SC-LIO-SAM and hdl_graph_slam make a map as ours do."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData
from firstfix.transform import transform_points
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.map_of_scans import is_map_of_scans, read_map_of_scans
from firstfix_builder.sources.read_map.mapping_scans import MappingScans
from tests.builder.sources.read_map.mapping_run import drive, write_run
from tests.builder.sources.read_map.program_folders import (
    kitti,
    write_hdl_graph_slam,
    write_pcd,
    write_sc_lio_sam,
)

RUN = drive(24)
SCANS, POSES = [scan for scan, _ in RUN], [T for _, T in RUN]
WRITERS = {"SC-LIO-SAM": write_sc_lio_sam, "hdl_graph_slam": write_hdl_graph_slam}


@pytest.mark.parametrize("program", WRITERS)
def test_a_programs_scans_make_the_map_of_our_own_form(tmp_path, program):
    WRITERS[program](tmp_path / "theirs", SCANS, POSES)
    ours, theirs = read_map(write_run(tmp_path / "ours", RUN)), read_map(tmp_path / "theirs")
    np.testing.assert_allclose(theirs.trajectory, ours.trajectory, atol=1e-4)  # Eigen writes six digits
    everything = np.concatenate([transform_points(T, scan) for scan, T in RUN])
    assert abs(len(theirs.points) - len(ours.points)) < 0.02 * len(ours.points)
    np.testing.assert_allclose(theirs.points.min(axis=0), everything.min(axis=0), atol=0.05)
    np.testing.assert_allclose(theirs.points.max(axis=0), everything.max(axis=0), atol=0.05)
    assert theirs.read.form == f"{program}'s scans"
    assert len(theirs.read.clouds) == len(RUN)


@pytest.mark.parametrize("program", WRITERS)
def test_held_out_keyframes_are_named_and_left_out(tmp_path, program):
    WRITERS[program](tmp_path, SCANS, POSES)
    made = read_map_of_scans(tmp_path, "z-up", 1.0, held_out=4)
    assert len(made.held_out.scans) == len(made.names_held_out) > 0
    rest = MappingScans(tmp_path, "z-up", without=made.names_held_out)
    assert len(rest) == len(RUN) - len(made.names_held_out)


def test_a_map_of_features_beside_the_scans_is_not_the_map(tmp_path):
    write_sc_lio_sam(tmp_path, SCANS, POSES)
    write_pcd(tmp_path / "cloudGlobal.pcd", np.zeros((9, 3)))
    assert is_map_of_scans(tmp_path)


def test_a_scan_without_a_pose_is_left_out(tmp_path):
    write_sc_lio_sam(tmp_path, SCANS, POSES)
    (tmp_path / "optimized_poses.txt").write_text(kitti(POSES[:-2]))
    (tmp_path / "Scans" / "000003.pcd").write_bytes(b"no cloud")
    data = read_map(tmp_path)
    assert len(data.trajectory) == len(RUN) - 3
    assert sum(one.count for one in data.read.left_out) == 3


def test_scans_have_the_pose_of_their_number_and_not_of_their_place(tmp_path):
    write_sc_lio_sam(tmp_path, SCANS, POSES)
    expected = read_map(tmp_path)
    for file in (tmp_path / "Scans").iterdir():
        file.rename(file.with_name(f"key_{int(file.stem)}.pcd"))  # key_10 stands before key_2
    (tmp_path / "Scans" / "._key_0.pcd").write_bytes(b"of macOS")
    found = read_map(tmp_path)
    np.testing.assert_array_equal(found.points, expected.points)
    assert found.read.left_out == ()
    (tmp_path / "Scans" / "key_0.pcd").unlink()
    np.testing.assert_allclose(read_map(tmp_path).trajectory, expected.trajectory[1:])


@pytest.mark.parametrize(
    ("rename", "reason"),
    [
        (lambda number: f"{number + 1:06d}.pcd", "numbered 1 to 24, and there are 24 poses"),
        (lambda number: f"{chr(97 + number)}.pcd", "a.pcd has no number"),
        (lambda number: f"{number}_{number // 2}.pcd", "two scans have the number"),
    ],
)
def test_scans_whose_poses_cannot_be_told_are_refused(tmp_path, rename, reason):
    write_sc_lio_sam(tmp_path, SCANS, POSES)
    for file in sorted((tmp_path / "Scans").iterdir(), reverse=True):
        file.rename(file.with_name(rename(int(file.stem))))
    with pytest.raises(MalformedData, match=reason):
        read_map(tmp_path)


def test_a_damaged_pose_is_named(tmp_path):
    write_hdl_graph_slam(tmp_path, SCANS, POSES)
    (tmp_path / "000002" / "data").write_text("stamp 1 0\nestimate\n1 0 0\n")
    with pytest.raises(MalformedData, match=r"keyframes/ can be used: .*000002: data: .*no estimate"):
        read_map(tmp_path)
