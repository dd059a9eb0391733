"""Every sample file: the right point count, or its clear error. Skipped where the samples are not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, UnsupportedFormat
from firstfix_builder.sources.read_map import read_map, read_trajectory
from tests.needs import RECORDED, with_recorded

pytestmark = with_recorded("formats")

POINTS = {
    "formats/converted/hall_scan60.ascii.pcd": 20_000,
    "formats/converted/hall_scan60.ascii.ply": 20_000,
    "formats/converted/hall_scan60.binary.pcd": 20_000,
    "formats/converted/hall_scan60.binary_be.ply": 20_000,
    "formats/converted/hall_scan60.binary_compressed.pcd": 20_000,
    "formats/converted/hall_scan60.binary_le.ply": 20_000,
    "formats/converted/hall_scan60.csv": 20_000,
    "formats/converted/hall_scan60.double_xyz.binary.pcd": 20_000,
    "formats/converted/hall_scan60.kitti.bin": 20_000,
    "formats/converted/hall_scan60.nan_ring_t_timestamp.binary.pcd": 19_600,  # 400 rows are NaN
    "formats/converted/hall_scan60.npy": 20_000,
    "formats/converted/hall_scan60.pts": 20_000,
    "formats/converted/hall_scan60.utm_double.ply": 20_000,
    "formats/converted/hall_scan60.v12.las": 20_000,
    "formats/converted/hall_scan60.v12.laz": 20_000,
    "formats/converted/hall_scan60.v14.las": 20_000,
    "formats/converted/hall_scan60.xyz": 20_000,
    "formats/converted/hall_scan60_utm.v14.laz": 20_000,
    "formats/converted/hall_two_scans_posed.e57": 40_000,
    "formats/original/3dtk_scan000.3d": 81_360,
    "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3_map-000.ply": 155_000,
    "formats/original/helipr_avia_000000.bin": 12_320,
    "formats/original/kitti00_000094.bin": 121_618,
    "formats/original/laspy_autzen_trim.laz": 110_000,
    "formats/original/laspy_extrabytes.las": 1_065,
    "formats/original/laspy_fullwave.laz": 10_750,
    "formats/original/laspy_simple.copc.laz": 1_065,
    "formats/original/laspy_simple.laz": 1_065,
    "formats/original/laspy_simple1_4.las": 22_600,
    "formats/original/nclt_1326652795280148.velodyne_sync.bin": 23_546,
    "formats/original/ndt_outdoor_map.ascii.pcd": 49_168,
    "formats/original/pcl_room_scan1.binary_compressed.pcd": 112_586,
    "formats/original/pcl_room_scan2.binary_compressed.pcd": 112_624,
    "formats/original/pcl_terrain_samp11_utm.binary_compressed.pcd": 38_010,
    "formats/original/planeloc_width0_points26585.binary.pcd": 26_585,
    "formats/original/pye57_normals_tiny.e57": 2,
    "formats/original/pye57_pump.e57": 155_201,
    "formats/original/pye57_translation_only_tiny.e57": 4,
    "formats/original/small_gicp_source.ply": 69_792,
    "formats/original/small_gicp_target.ply": 69_088,
    "formats/original/velodyne_ring_padding.binary.pcd": 64_545,
    "user_maps/imm_lio_fastlio_style_scans.pcd": 15_333,
    "user_maps/dddmr_lego_loam_outdoor_yup": 62_445 + 27_045,
    "user_maps/lio_sam_layout_SIMULATED": 5_749,
    "user_maps/livox_mid40_loam_hall": 63_381 + 91_531,
}
ERRORS: dict[str, tuple[type[InputError], str]] = {
    "formats/converted/hall_3scans_pointcloud2.ros1.bag": (UnsupportedFormat, "a recording, not a map"),
    "formats/converted/hall_3scans_pointcloud2.ros2_mcap": (UnsupportedFormat, "a recording, not a map"),
    "formats/converted/hall_3scans_pointcloud2.ros2_sqlite3": (UnsupportedFormat, "a recording, not a map"),
    "formats/converted/malformed_empty.pcd": (MalformedData, "the file is empty"),
    "formats/converted/malformed_truncated.binary.pcd": (
        MalformedData,
        "cut off: 199812 of 320000 bytes",
    ),
    "formats/original/3dtk_scan000.pose": (UnsupportedFormat, "ends in '.pose'"),
    "formats/original/OS-1-128_v2.3.0_1024x10.json": (UnsupportedFormat, "ends in '.json'"),
    "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3.osf": (UnsupportedFormat, "a recording, not a map"),
    "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3.pcap": (UnsupportedFormat, "a recording, not a map"),
    "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3_poses_kitti.txt": (MalformedData, "rows of 12 numbers"),
    "formats/original/kitti00_000094.T_map_lidar.txt": (MalformedData, "a pose, not points"),
    "formats/original/ouster_512x10_raw_packets.bag": (UnsupportedFormat, "a recording, not a map"),
    "formats/original/small_gicp_T_target_source.txt": (MalformedData, "a pose, not points"),
}
POSES = {
    "kitti_drive0027_street/poses.csv": 441,
    "hilti_hall_indoor/poses.csv": 168,
    "rotation_in_place_11/pose.json": 11,
    "formats/original/OS-1-128_v2.3.0_1024x10_lb_n3_poses_kitti.txt": 3,
    "formats/original/kitti00_000094.T_map_lidar.txt": 1,
    "formats/original/small_gicp_T_target_source.txt": 1,
    "user_maps/lio_sam_layout_SIMULATED/trajectory.pcd": 122,
    "user_maps/lio_sam_layout_SIMULATED/transformations.pcd": 122,
    "user_maps/livox_mid40_loam_hall/key_frame.txt": 67,
}


@pytest.mark.parametrize("name", POINTS)
def test_the_right_point_count(name):
    data = read_map(RECORDED / name)
    assert data.points is not None
    assert data.points.shape == (POINTS[name], 3)
    assert data.points.dtype == np.float64
    assert np.isfinite(data.points).all()
    assert np.abs(data.points[:, :2]).max() < 10_000


@pytest.mark.parametrize("name", ERRORS)
def test_the_clear_error(name):
    error, reason = ERRORS[name]
    with pytest.raises(error, match=reason) as caught:
        read_map(RECORDED / name)
    assert type(caught.value) is error
    assert str(caught.value).startswith(Path(name).name + ": ")


def test_no_sample_is_left_out():
    listed = set(POINTS) | set(ERRORS)
    there = {
        f"{folder}/{entry.name}"
        for folder in ("formats/converted", "formats/original", "user_maps")
        for entry in (RECORDED / folder).iterdir()
        if entry.name != "README.md"
    }
    assert there == listed


@pytest.mark.parametrize("name", POSES)
def test_the_right_number_of_poses(name):
    poses = read_trajectory(RECORDED / name)
    assert poses.shape == (POSES[name], 4, 4)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1),
        np.tile(np.eye(3), (len(poses), 1, 1)),
        atol=1e-9,
    )


def test_the_same_hall_whatever_the_format():
    """Formats that keep the order of the points agree with the binary PCD to what their digits allow."""
    truth = read_map(RECORDED / "formats/converted/hall_scan60.binary.pcd").points
    for name, count in POINTS.items():
        if "hall_scan60" in name and count == 20_000:
            data = read_map(RECORDED / name)
            shift = np.array([512_345.6, 5_403_210.1, 295.5]) if "utm" in name else np.zeros(3)
            np.testing.assert_allclose(data.points + data.origin - shift, truth, atol=0.001, err_msg=name)


def test_the_livox_hall_lies_around_its_trajectory():
    """A wrong order of the quaternion's or the vector's numbers leaves the map's box."""
    data = read_map(RECORDED / "user_maps/livox_mid40_loam_hall")
    positions = data.trajectory[:, :3, 3]
    low, high = data.points.min(axis=0), data.points.max(axis=0)
    assert ((positions > low) & (positions < high)).all()
    assert np.ptp(positions, axis=0).max() > 40


def test_the_y_up_map_lies_flat_once_turned():
    folder = RECORDED / "user_maps/dddmr_lego_loam_outdoor_yup"
    turned = np.ptp(read_map(folder, axis="y-up").points, axis=0)
    as_it_is = np.ptp(read_map(folder).points, axis=0)
    assert as_it_is[1] < 30 < min(as_it_is[0], as_it_is[2])
    assert turned[2] < 30 < min(turned[0], turned[1])
    ground = read_map(folder / "ground.pcd", axis="y-up").points[:, 2].mean()
    assert ground < read_map(folder / "map.pcd", axis="y-up").points[:, 2].mean()


def test_the_rotation_in_place_turns_the_scans_onto_each_other():
    folder = RECORDED / "rotation_in_place_11"
    poses = read_trajectory(folder / "pose.json")
    yaw_deg = np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    assert yaw_deg[0] == pytest.approx(0, abs=1)
    assert yaw_deg[-1] == pytest.approx(-128, abs=1)


def test_sample_meshes():
    for name, triangles in (("office_willow_garage", 12_734), ("warehouse_aws_small", 14_997)):
        data = read_map(RECORDED / "worlds" / f"{name}.ply")
        assert data.points is None
        assert data.triangles.shape == (triangles, 3)
        assert data.triangles.max() < len(data.vertices)
