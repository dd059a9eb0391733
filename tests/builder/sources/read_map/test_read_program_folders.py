from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, UnsupportedFormat
from firstfix.transform import from_quaternion, transform_points
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.folders.autoware_projection import projection_of
from firstfix_builder.sources.read_map.what_was_read import LeftOut
from tests.builder.sources.read_map import program_folders as written
from tests.every_case import every_case

RNG = np.random.default_rng(8)
DEPOT = RNG.uniform([0, 0, 0], [38, 35, 5], (900, 3)).astype("<f4")
POSES = [from_quaternion([2.0 + 3 * n, 3.0, 1.2], [0, 0, 0.1 * n, 1.0]) for n in range(6)]


def same_points(found: np.ndarray | None, expected: np.ndarray) -> None:
    """Tiles are read by their names, in any order of the list."""
    assert found is not None
    ordered = [rows[np.lexsort(rows.round(3).T)] for rows in (found, np.asarray(expected, np.float64))]
    np.testing.assert_allclose(*ordered, atol=1e-5)


@pytest.mark.parametrize("tiles", ["pointcloud_map.pcd", "pointcloud_map", "."])
def test_autowares_tiles_are_one_map(tmp_path, tiles):
    written.write_divided_map(tmp_path, DEPOT, tiles)
    data = read_map(tmp_path)
    same_points(data.points, DEPOT)
    assert data.read.form == "Autoware's divided map, 4 of 4 tiles"
    assert data.read.georeference == "MGRS 54SVE heights EGM2008"
    assert data.read.clouds == ("map_0_0.pcd", "map_0_20.pcd", "map_20_0.pcd", "map_20_20.pcd")
    assert data.read.left_out == ()


def test_missing_and_unlisted_tiles_are_named(tmp_path):
    written.write_divided_map(tmp_path, DEPOT)
    tiles = tmp_path / "pointcloud_map.pcd"
    (tiles / "map_0_20.pcd").unlink()
    written.write_pcd(tiles / "old.pcd", DEPOT)
    data = read_map(tmp_path)
    same_points(data.points, DEPOT[(DEPOT[:, 0] >= 20) | (DEPOT[:, 1] < 20)])
    assert [one.words for one in data.read.left_out] == [
        "left out: tile map_0_20.pcd (it is listed, and not there)",
        "left out: 1 tiles (not listed in pointcloud_map_metadata.yaml, as old.pcd)",
    ]
    shutil.rmtree(tiles)
    with pytest.raises(MalformedData, match=r"lists 4 tiles, and none is there: map_0_0\.pcd"):
        read_map(tmp_path)


def listed_by_path(folder, begin: str) -> None:
    """A divided map whose list has the tiles with their folder."""
    written.write_divided_map(folder, DEPOT)
    list_file = folder / "pointcloud_map_metadata.yaml"
    list_file.write_text(list_file.read_text().replace("map_", f"{begin}map_"))


def test_tiles_listed_by_paths_inside_of_the_folder_are_read(tmp_path):
    listed_by_path(tmp_path, "pointcloud_map.pcd/")
    data = read_map(tmp_path)
    same_points(data.points, DEPOT)
    assert data.read.form == "Autoware's divided map, 4 of 4 tiles"
    assert data.read.left_out == ()


@pytest.mark.parametrize("begin", ["../pointcloud_map.pcd/", "/etc/", "a//", "./", ".hidden/", "a/../../"])
def test_paths_out_of_the_folder_are_refused(tmp_path, begin):
    listed_by_path(tmp_path, begin)
    with pytest.raises(MalformedData, match=r"is not the name of a tile, or a path to one inside of the fol"):
        read_map(tmp_path)


def test_a_link_in_a_path_leads_not_out_of_the_folder(tmp_path):
    folder, aside = tmp_path / "map", tmp_path / "aside"
    folder.mkdir()
    listed_by_path(folder, "tiles/")
    (folder / "pointcloud_map.pcd").rename(aside)
    (folder / "tiles").symlink_to(aside)
    with pytest.raises(MalformedData, match="none is there"):
        read_map(folder)


def test_a_damaged_projector_refuses_no_map(tmp_path):
    written.write_divided_map(tmp_path, DEPOT)
    (tmp_path / "map_projector_info.yaml").write_text("map_origin: [1\n")
    data = read_map(tmp_path)
    same_points(data.points, DEPOT)
    (left_out,) = data.read.left_out
    assert left_out.what == "map_projector_info.yaml"
    assert "while parsing" in left_out.reason


ORIGIN = {"latitude": 35.6762, "longitude": 139.6503, "altitude": 12.0}
TANGENT = {"projector_type": "LocalCartesian", "vertical_datum": "WGS84", "map_origin": ORIGIN}
BODY = '{"latitude_deg": 35.6762, "longitude_deg": 139.6503, "height_m": 0.0, "x_axis_deg": 0.0}'


@every_case(
    ("told", "note"),
    [
        ({"projector_type": "Local"}, ""),
        ({}, ""),
        (TANGENT, f"takes {BODY}"),
        (TANGENT | {"vertical_datum": "EGM2008"}, "heights are EGM2008"),
        (TANGENT | {"map_origin": {}}, "map_origin is not one"),
        (
            TANGENT | {"map_origin": ORIGIN | {"latitude": 91}},
            "map_origin is not one: a latitude is within 90",
        ),
        ({"projector_type": "MGRS", "vertical_datum": "WGS84", "mgrs_grid": "54SUE"}, "MGRS is a projection"),
        (
            {"projector_type": "TransverseMercator", "map_origin": ORIGIN},
            "TransverseMercator is a projection",
        ),
    ],
)
def test_the_projector_gives_the_georeference_where_it_is_a_frame(told, note):
    notes = projection_of(told).notes
    assert (notes == ()) if not note else (note in notes[0])


@pytest.mark.parametrize(
    ("write", "lost", "reason"),
    [
        (written.write_sc_lio_sam, ["optimized_poses.txt"], "optimized_poses.txt is not beside Scans"),
        (written.write_sc_lio_sam, ["Scans"], "Scans with its .pcd files is not there"),
        (written.write_hdl_graph_slam, [f"00000{n}" for n in range(6)], "000000/data and .* are not there"),
        (
            lambda folder, scans, poses: written.write_kiss_slam(folder, scans, poses, DEPOT),
            ["local_maps"],
            "local_maps/plys with its .ply files is not there",
        ),
    ],
    ids=["SC-LIO-SAM's poses", "SC-LIO-SAM's scans", "hdl_graph_slam's keyframes", "KISS-SLAM's local maps"],
)
def test_what_a_folder_lacks_is_named(tmp_path, write, lost, reason):
    write(tmp_path, np.array_split(DEPOT, 6), POSES)
    for name in lost:
        lost_part = tmp_path / name
        lost_part.unlink() if lost_part.is_file() else shutil.rmtree(lost_part)
    with pytest.raises(UnsupportedFormat, match=reason):
        read_map(tmp_path)


@every_case(
    ("text", "reason"),
    [
        ("", "lists nothing"),
        ("- 1\n", "lists nothing"),
        ("x_resolution: 20.0\n", "lists no tile"),
        ("../a.pcd: [0, 0]\n", "not the name of a tile"),
        ("a: [\n", "while parsing"),
        ("[" * 3000, "."),
    ],
)
def test_a_damaged_list_of_tiles_is_named(tmp_path, text, reason):
    written.write_divided_map(tmp_path, DEPOT)
    (tmp_path / "pointcloud_map_metadata.yaml").write_text(text)
    with pytest.raises(MalformedData, match=rf"pointcloud_map_metadata\.yaml: .*{reason}"):
        read_map(tmp_path)


def test_the_folder_of_tiles_alone_is_parts_of_a_map(tmp_path):
    written.write_divided_map(tmp_path, DEPOT)
    data = read_map(tmp_path / "pointcloud_map.pcd")
    same_points(data.points, DEPOT)
    assert data.read.form == "4 clouds in one frame"


def test_fast_lios_intervals_are_one_map_with_the_rest(tmp_path):
    around_the_start = DEPOT - np.array([18, 17, 1.5], "<f4")
    parts = np.array_split(around_the_start, 12)
    written.write_intervals(tmp_path, parts[:-1], parts[-1])
    data = read_map(tmp_path)
    np.testing.assert_array_equal(data.points, around_the_start)  # 10 comes after 9
    assert data.read.form == "FAST-LIO's folder"


def test_missing_intervals_are_named(tmp_path):
    written.write_intervals(tmp_path, np.array_split(DEPOT, 6))
    for number in (2, 5):
        (tmp_path / f"scans_{number}.pcd").unlink()
    found = read_map(tmp_path).read.left_out
    assert found == (LeftOut("intervals", "not there, as scans_2.pcd, though later ones are", 2),)


HALVES = (DEPOT[:450], DEPOT[450:])
FOLDERS = {
    "Autoware": lambda folder: written.write_divided_map(folder, DEPOT),
    "FAST-LIO": lambda folder: written.write_intervals(folder, HALVES),
    "KISS-SLAM": lambda folder: written.write_kiss_slam(folder, HALVES, POSES, DEPOT),
    "RTAB-Map": lambda folder: written.write_rtabmap(folder, DEPOT, POSES),
    "HDMapping": lambda folder: written.write_hdmapping(folder, HALVES, (POSES[:3], POSES[3:])),
    "one file": lambda folder: written.write_pcd(folder / "my map.pcd", DEPOT),
    "two files": lambda folder: [written.write_ply(folder / f"{at}.ply", DEPOT + [30, 30, 0]) for at in "ab"],
}
_OF_MACOS = b"\0\5\x16\7\0\2\0\0Mac OS X        " + bytes(100)


@pytest.mark.parametrize("program", FOLDERS)
def test_hidden_files_are_no_part_of_a_map(tmp_path, program):
    folder = tmp_path / "my map (2) ü"
    FOLDERS[program](folder)
    expected = read_map(folder)
    for file in [path for path in folder.rglob("*") if path.is_file()]:
        file.with_name(f"._{file.name}").write_bytes(_OF_MACOS)
    (folder / ".DS_Store").write_bytes(b"Bud1")
    found = read_map(folder)
    np.testing.assert_array_equal(found.points, expected.points)
    assert found.read == expected.read
    with pytest.raises(UnsupportedFormat, match=r"no map file, but folders: my map \(2\) ü\. Give the one"):
        read_map(tmp_path)


def test_clouds_around_their_own_origins_or_far_apart_are_asked_about(tmp_path):
    for number in range(3):
        written.write_pcd(tmp_path / f"{number:06d}.pcd", DEPOT[number::3] - [10 + number, 9, 1.5])
    with pytest.raises(UnsupportedFormat, match=r"has 3 map files instead of one, and 3 .* mapping_scans/"):
        read_map(tmp_path)
    for number in range(3):
        written.write_pcd(tmp_path / f"{number:06d}.pcd", DEPOT + [0, 300 * number, 0])
    with pytest.raises(UnsupportedFormat, match=r"000001\.pcd lies over 50 m from the others"):
        read_map(tmp_path)


def test_storeys_and_texts_beside_them(tmp_path):
    written.write_pcd(tmp_path / "ground floor.pcd", DEPOT - [10, 9, 1.5])
    written.write_ply(tmp_path / "first floor.ply", DEPOT - [10, 9, -4])
    (tmp_path / "times.txt").write_text("1\n2\n")
    (tmp_path / "poses.txt").write_text(written.kitti(POSES))
    data = read_map(tmp_path)
    same_points(data.points, np.concatenate([DEPOT - [10, 9, 1.5], DEPOT - [10, 9, -4]]))
    np.testing.assert_allclose(data.trajectory, POSES, atol=1e-6)
    assert data.read.poses == "poses.txt"


def test_kiss_slams_local_maps_and_poses_are_in_one_frame(tmp_path):
    parts = np.array_split(DEPOT, 3)
    written.write_kiss_slam(tmp_path, parts, POSES, DEPOT @ np.diag([1, -1, -1.0]))
    data = read_map(tmp_path)
    np.testing.assert_array_equal(data.points, DEPOT)
    np.testing.assert_allclose(data.trajectory, POSES, atol=1e-6)
    assert data.read.poses == "hall_poses_tum.txt"
    assert data.read.left_out[0].what == "occupancy_grid/occupancy_pcd.ply"
    tmp_path.rename(tmp_path.with_name("2026-11-30_04-25-27"))
    (tmp_path / "slam_output").mkdir(parents=True)
    (tmp_path / "slam_output/latest").symlink_to(tmp_path.with_name("2026-11-30_04-25-27"))
    np.testing.assert_array_equal(read_map(tmp_path / "slam_output").points, DEPOT)


@pytest.mark.parametrize("lean_deg", [0.0, 4.0, 10.0, 25.0])
def test_kiss_slams_map_that_leans_is_level_with_its_poses(tmp_path, lean_deg):
    """The first scan's frame is the map's, and the LiDAR of a robot may look down."""
    floor = RNG.uniform([0, 0, 0], [30, 20, 0.01], (6000, 3))
    walls = RNG.uniform([0, 0, 0], [30, 0.01, 4], (3000, 3)), RNG.uniform([0, 0, 0], [0.01, 20, 4], (2000, 3))
    hall = np.concatenate([floor, *walls])
    half = np.radians(lean_deg) / 2
    T_kiss_hall = from_quaternion([0, 0, 0], [0, np.sin(half), 0, np.cos(half)])
    leaning, poses = transform_points(T_kiss_hall, hall), [T_kiss_hall @ T for T in POSES]
    written.write_kiss_slam(tmp_path, [leaning], poses, hall)
    data = read_map(tmp_path)
    turned = lean_deg > 5.0
    np.testing.assert_allclose(data.points, hall if turned else leaning, atol=0.1)
    np.testing.assert_allclose(data.trajectory, POSES if turned else poses, atol=0.05)
    assert any("turned level" in note for note in data.read.notes) == turned


@pytest.mark.parametrize(
    ("kinds", "used"), [(("", "_scan"), "office_scan_poses.txt"), (("",), "office_poses.txt")]
)
def test_rtabmaps_export_brings_its_poses(tmp_path, kinds, used):
    written.write_rtabmap(tmp_path, DEPOT, POSES, (*kinds, "_camera"))
    data = read_map(tmp_path)
    np.testing.assert_array_equal(data.points, DEPOT)
    np.testing.assert_allclose(data.trajectory, POSES, atol=1e-6)
    assert data.read.poses == used
    assert ("rtabmap-export --poses_scan" in "".join(data.read.notes)) == (used == "office_poses.txt")
    assert data.read.left_out == (LeftOut("files of poses", "of cameras' optical frames", 1),)


def test_hdmappings_chunks_stand_where_their_poses_say(tmp_path):
    chunks, ways = np.array_split(DEPOT.astype(np.float64), 2), [POSES[:3], POSES[3:]]
    written.write_hdmapping(tmp_path, chunks, ways)
    data = read_map(tmp_path)
    np.testing.assert_allclose(data.points, DEPOT, atol=2e-4)
    np.testing.assert_allclose(data.trajectory, POSES, atol=1e-6)
    assert data.read.form == "HDMapping's session, 2 chunks"
    (tmp_path / "scan_lio_1.laz").unlink()
    data = read_map(tmp_path)
    np.testing.assert_allclose(data.points, chunks[0], atol=2e-4)
    assert data.read.left_out[0].what == "chunk scan_lio_1.laz"


def test_hdmappings_offset_is_in_the_coordinates(tmp_path):
    offset = np.array([500_000.0, 5_000_000.0, 100.0])
    written.write_hdmapping(tmp_path, [DEPOT.astype(np.float64)], [POSES], offset)
    data = read_map(tmp_path)
    np.testing.assert_allclose(data.points + data.origin, DEPOT + offset, atol=2e-4)
    np.testing.assert_allclose(data.trajectory[0, :3, 3] + data.origin, POSES[0][:3, 3] + offset)


@every_case(
    ("name", "text"),
    [
        ("poses.reg", ""),
        ("poses.reg", "2\nscan_lio_0.laz\n1 0 0 0\n"),
        ("poses.reg", "1\nscan_lio_0.laz\n" + "1 0 0\n" * 4),
        ("poses.reg", "1\nscan_lio_0.laz\n" + "2 0 0 0\n" * 4),
        ("session.json", "{"),
        ("session.json", '{"Session Settings": {"offset_x": "far"}, "laz_file_names": []}'),
        ("trajectory_lio_0.csv", "timestamp pose00\n1 2\n"),
    ],
)
def test_a_damaged_session_of_hdmapping_is_named(tmp_path, name, text):
    written.write_hdmapping(tmp_path, [DEPOT.astype(np.float64)], [POSES])
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}|the session's offset"):
        read_map(tmp_path)


@every_case(
    ("name", "said"),
    [
        ("office.db", "rtabmap-export --scan --poses_scan"),
        ("map.mm", "mm2ply"),
        ("map.simplemap", "sm2mm"),
        ("map.pbstream", "cartographer_assets_writer"),
        ("map.bin", "CloudCompare's own file: .* -C_EXPORT_FMT PLY"),
    ],
)
def test_files_of_programs_are_named_with_what_writes_one_that_is_read(tmp_path, name, said):
    (tmp_path / name).write_bytes(b"CCB2" + bytes(996))
    with pytest.raises(UnsupportedFormat, match=said):
        read_map(tmp_path / name)
    with pytest.raises(UnsupportedFormat, match=said):
        read_map(_alone(tmp_path, name))


def _alone(folder: Path, name: str) -> Path:
    """A folder with nothing else."""
    alone = folder / f"only {name}"
    alone.mkdir()
    shutil.copy(folder / name, alone / name)
    return alone
