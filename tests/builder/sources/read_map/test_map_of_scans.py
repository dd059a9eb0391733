"""A map of nothing but mapping scans: exact geometry, what is held out of it, and what cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.builds.config import BuildConfig
from firstfix.errors import MalformedData, NotFound
from firstfix.transform import inverse, transform_points
from firstfix_builder.mesh.clean_cloud import voxel_means
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.held_out import HeldOut
from firstfix_builder.sources.read_map.held_out_parts import ALONE, FEW, drawn_parts
from firstfix_builder.sources.read_map.map_of_scans import VOXEL_M, is_map_of_scans, read_map_of_scans
from firstfix_builder.sources.write_level_map import write_level_map
from firstfix_builder.stage_results import MOVING_FILE
from firstfix_cli.map_source import as_one_file
from tests.builder.sources.read_map.mapping_run import drive, name_of, street, write_run
from tests.builder.stages import stages_below

UTM = (353_071.25, 5_425_012.5, 31.0)


def numbers_of(held_out: HeldOut) -> list[int]:
    return [int(one.name.removeprefix("mapping_scans/").removesuffix(".npy")) for one in held_out.scans]


def test_the_map_is_all_scans_at_their_poses(tmp_path: Path):
    posed = drive(24)
    found = read_map(write_run(tmp_path, posed))
    assert found.points is not None
    assert found.trajectory is not None
    joined = np.concatenate([transform_points(T, scan.astype(np.float64)) for scan, T in posed])
    np.testing.assert_allclose(found.points, voxel_means(joined, VOXEL_M), atol=1e-9)
    np.testing.assert_allclose(found.trajectory, [T for _, T in posed], atol=1e-9)
    assert not found.origin.any()


def test_the_map_has_what_its_scans_saw_in_utm_too(tmp_path: Path):
    found = read_map(write_run(tmp_path, drive(24, origin=UTM)))
    assert found.points is not None
    assert found.trajectory is not None
    assert found.origin.tolist() == [353_000, 5_425_000, 0]
    assert np.abs(found.trajectory[:, :2, 3]).max() < 150
    away_m = cKDTree(street(24) + UTM - found.origin).query(found.points)[0]
    assert np.median(away_m) < 1e-3
    assert away_m.max() < VOXEL_M


def test_held_out_keyframes_are_not_in_the_map(tmp_path: Path):
    marks = np.array([[0.0, 0, 40 + k] for k in range(80)], np.float32)  # a mark above each keyframe
    posed = [
        (np.concatenate([scan, transform_points(inverse(T), mark[None] + [T[0, 3], T[1, 3], 0])]), T)
        for (scan, T), mark in zip(drive(80, origin=UTM), marks, strict=True)
    ]
    source = write_run(tmp_path, [(scan.astype(np.float32), T) for scan, T in posed])
    found = read_map_of_scans(source, "z-up", 1.0, held_out=40)
    out = numbers_of(found.held_out)
    told = found.held_out.of_map
    assert told is not None
    assert (told.keyframes, told.parts, told.kept_out) == (8, 4, {})
    assert len(out) == len(set(out)) == 8
    assert found.data.points is not None
    assert found.data.trajectory is not None
    in_map = {round(float(z)) - 40 for z in found.data.points[:, 2] if z > 39}
    assert in_map == set(range(80)) - set(out)
    np.testing.assert_allclose(
        found.data.trajectory, [T for k, (_, T) in enumerate(posed) if k not in out], atol=1e-6
    )
    for one, number in zip(found.held_out.scans, out, strict=True):
        np.testing.assert_array_equal(one.scan.points, posed[number][0].astype(np.float32))
        np.testing.assert_allclose(one.T_sensor, posed[number][1], atol=1e-6)
    again = read_map_of_scans(source, "z-up", 1.0, held_out=40)
    assert numbers_of(again.held_out) == out
    np.testing.assert_array_equal(again.data.points, found.data.points)
    assert not read_map_of_scans(source, "z-up", 1.0).held_out.scans


def test_a_part_that_alone_saw_a_place_stays_in_the_map(tmp_path: Path):
    posed = drive(80)
    parts = drawn_parts(np.array([T[:3, 3] for _, T in posed]), 40)
    room = np.random.default_rng(0).uniform([0, 30, 0], [4, 34, 3], (2000, 3))
    scan, T = posed[parts[1].start]
    posed[parts[1].start] = (
        np.concatenate([scan, transform_points(inverse(T), room).astype(np.float32)]),
        T,
    )
    found = read_map_of_scans(write_run(tmp_path, posed), "z-up", 1.0, held_out=40)
    told = found.held_out.of_map
    assert told is not None
    assert told.parts == len(parts) - 1
    assert told.kept_out == {ALONE: len(parts[1])}
    assert set(numbers_of(found.held_out)) == {k for part in parts if part != parts[1] for k in part}
    assert found.data.points is not None
    assert cKDTree(found.data.points).query(room)[0].max() < VOXEL_M * 2
    assert found.data.trajectory is not None
    assert len(found.data.trajectory) == 80 - told.keyframes


def test_where_keyframes_stand_far_apart_none_is_held_out(tmp_path: Path):
    found = read_map_of_scans(write_run(tmp_path, drive(30, step_m=11.0)), "z-up", 1.0, held_out=40)
    assert found.held_out.scans == ()
    assert found.held_out.of_map is not None
    assert sum(found.held_out.of_map.kept_out.values()) == 3
    assert found.data.trajectory is not None
    assert len(found.data.trajectory) == 30


def test_of_few_keyframes_none_is_held_out(tmp_path: Path):
    found = read_map_of_scans(write_run(tmp_path, drive(19)), "z-up", 1.0, held_out=40)
    assert found.held_out.of_map is not None
    assert found.held_out.of_map.to_mapping() == {"keyframes": 0, "parts": 0, "kept_out": {FEW: 19}}


def test_bad_rows_are_left_out_with_their_reasons(tmp_path: Path):
    rows = [
        "nowhere.npy,,,,,,,",
        "gone.npy,1,0,0,0,0,0,1",
        "../out.npy,1,0,0,0,0,0,1",
        "turn.npy,0,0,0,0,0,0,0",
    ]
    source = write_run(tmp_path, drive(24), rows)
    (source / "mapping_scans" / name_of(5)).write_bytes(b"\x93NUMPY")
    found = read_map_of_scans(source, "z-up", 1.0)
    assert found.left_out.keys() == {"nowhere.npy", "gone.npy", "../out.npy", "turn.npy", name_of(5)}
    assert found.left_out["gone.npy"] == "no such file"
    assert found.data.trajectory is not None
    assert len(found.data.trajectory) == 23
    assert str(tmp_path) not in str(found.left_out)


def test_a_scan_that_is_listed_twice_is_not_held_out_and_in_the_map(tmp_path: Path):
    source = write_run(tmp_path, drive(80))
    once = read_map_of_scans(source, "z-up", 1.0, held_out=40)
    with (source / "mapping_scans" / "poses.csv").open("a") as file:
        file.write("".join(f"./{name_of(k)},{k},0.5,1.5,0,0,0,1\n" for k in numbers_of(once.held_out)))
        file.write(f"{name_of(3)},3,0.5,1.5,0,0,0,1\n")
    found = read_map_of_scans(source, "z-up", 1.0, held_out=40)
    assert numbers_of(found.held_out) == numbers_of(once.held_out)
    np.testing.assert_array_equal(found.data.points, once.data.points)
    assert len(found.left_out) == 8 + 1
    assert set(found.left_out.values()) == {"it is listed twice: its first row counts"}


def test_the_number_of_held_out_keyframes_is_part_of_the_first_stage_of_such_a_map_alone(tmp_path: Path):
    source, cloud = write_run(tmp_path / "run", drive(60)), tmp_path / "map.npy"
    np.save(cloud, street(60))

    def stage(path: Path, held_out: int) -> Path:
        config = BuildConfig.parse({"self_test": {"held_out": held_out}, "clean": {"min_neighbours": 0}})
        with stages_below(tmp_path / "work", config) as stages:
            return stages.read_map(path, None).directory

    assert stage(cloud, 0) == stage(cloud, 40)
    assert len({stage(source, 0), stage(source, 2), stage(source, 40)}) == 3
    with as_one_file(source) as archive:
        assert len({stage(archive, 0), stage(archive, 40)}) == 2


def test_if_no_scan_can_be_used_the_map_says_why(tmp_path: Path):
    source = write_run(tmp_path / "gone", [], ["gone.npy,1,0,0,0,0,0,1"])
    with pytest.raises(MalformedData, match=r"gone: no scan of mapping_scans/ .* gone.npy: no such file"):
        read_map(source)
    with pytest.raises(MalformedData, match="it lists no scan"):
        read_map(write_run(tmp_path / "none", []))
    (tmp_path / "bare" / "mapping_scans").mkdir(parents=True)
    with pytest.raises(MalformedData, match=r"used: poses.csv: no such file"):
        read_map(tmp_path / "bare")
    source = write_run(tmp_path / "turned", drive(3))
    with pytest.raises(MalformedData, match="must be z-up"):
        read_map(source, axis="y-up")
    with pytest.raises(MalformedData, match="must be in metres"):
        read_map(source, scale=0.001)
    with pytest.raises(NotFound):
        read_map(tmp_path / "nothing")


def test_a_map_file_beside_the_scans_is_the_map(tmp_path: Path):
    source = write_run(tmp_path, drive(24))
    assert is_map_of_scans(source)
    (source / "trajectory.txt").write_text("0 0 0 0 0 0 0 1\n")
    (source / "README.md").write_text("a street")
    assert is_map_of_scans(source)
    np.save(source / "map.npy", street(24))
    assert not is_map_of_scans(source)
    found = read_map(source)
    assert found.points is not None
    assert len(found.points) == len(street(24))
    assert not is_map_of_scans(source / "map.npy")
    assert not is_map_of_scans(tmp_path / "nothing")


def test_scans_of_its_own_and_held_out_scans_are_both_asked(tmp_path: Path):
    source, out = write_run(tmp_path / "source", drive(60, origin=UTM)), tmp_path / "out"
    (source / "mapping_scans" / name_of(7)).unlink()
    held = source / "held_out"
    held.mkdir()
    scan, T = drive(60, origin=UTM)[10]
    np.save(held / name_of(10), scan)
    rows = (source / "mapping_scans" / "poses.csv").read_text().splitlines()
    (held / "poses.csv").write_text("\n".join([rows[0], rows[11]]) + "\n")
    out.mkdir()
    write_level_map(source, None, BuildConfig(), out)
    kept = HeldOut.load(out)
    assert len(kept.scans) == 6 + 1
    assert kept.of_map is not None
    assert kept.of_map.keyframes == 6
    assert [one.name for one in kept.scans][-1] == name_of(10)
    T_map_level = np.load(out / "T_map_level.npy")
    np.testing.assert_allclose(T_map_level @ kept.scans[-1].T_sensor, T, atol=1e-6)
    tree = cKDTree(np.load(out / "points.npy"))
    for one in kept.scans:
        assert np.median(tree.query(transform_points(one.T_sensor, one.scan.points))[0]) < 0.1
    assert f'"{name_of(7)}": "no such file"' in (out / MOVING_FILE).read_text()
    assert len(np.load(out / "trajectory.npy")) == 60 - 6 - 1
