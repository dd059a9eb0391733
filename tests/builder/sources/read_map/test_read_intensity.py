"""Intensity as each kind of file has it: each point keeps its own, and no point is another because of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest
from scipy.spatial import cKDTree

from firstfix.builds.config import BuildConfig
from firstfix.scan.scan import Scan
from firstfix.transform import transform_points
from firstfix.wire.scan import encode_scan
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.write_level_map import write_level_map
from firstfix_builder.stage_results import INTENSITY_FILE, LevelMap
from tests.builder.sources.read_map.mapping_run import drive, write_run
from tests.builder.stages import stages_below

RNG = np.random.default_rng(6)
POINTS = RNG.uniform([0, 0, 0], [20, 8, 3], (4000, 3)).round(3)
POINTS[RNG.choice(4000, 2800, replace=False), 2] = 0.0  # a floor
BRIGHT = (2 * POINTS[:, 0] + 100).round()  # along x, in no file's order
LOW, HIGH = np.percentile(BRIGHT, (2, 98))


def wanted(points: np.ndarray) -> np.ndarray:
    return 255 * np.clip((2 * points[:, 0] + 100 - LOW) / (HIGH - LOW), 0, 1)


def write_ply(path: Path) -> None:
    rows = np.rec.fromarrays(
        [*POINTS.T, BRIGHT], dtype=[("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("i", "<f8")]
    )
    names = "".join(f"property double {name}\n" for name in ("x", "y", "z", "scalar_intensity"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{names}end_header\n"
    path.write_bytes(head.encode() + rows.tobytes())


def write_pcd(path: Path) -> None:
    rows = np.c_[POINTS, BRIGHT].astype("<f4")
    head = (
        "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(rows)}\nHEIGHT 1\nPOINTS {len(rows)}\nDATA binary\n"
    )
    path.write_bytes(head.encode() + rows.tobytes())


def write_las(path: Path) -> None:
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = POINTS.T
    las.intensity = BRIGHT.astype(np.uint16)
    las.write(path)


def write_e57(path: Path) -> None:
    file = pye57.E57(str(path), mode="w")
    for part in (slice(0, 1500), slice(1500, None)):
        columns = {f"cartesian{axis}": POINTS[part, i].copy() for i, axis in enumerate("XYZ")}
        file.write_scan_raw({**columns, "intensity": BRIGHT[part].copy()})
    file.close()


def write_ptx(path: Path) -> None:
    head = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    rows = [f"{x} {y} {z} {i}" for x, y, z, i in np.c_[POINTS, BRIGHT].tolist()]
    rows[7:7] = ["0 0 0 0.5"]
    blocks = [rows[:2001], rows[2001:]]
    path.write_text("".join(f"{len(one)}\n1\n{head}" + "\n".join(one) + "\n" for one in blocks))


def write_pts(path: Path) -> None:
    rows = [f"{x} {y} {z} {i}" for x, y, z, i in np.c_[POINTS, BRIGHT].tolist()]
    path.write_text("".join(f"{len(one)}\n" + "\n".join(one) + "\n" for one in (rows[:999], rows[999:])))


def write_csv(path: Path) -> None:
    rows = np.c_[BRIGHT, POINTS]
    rows[5, 1] = np.nan
    np.savetxt(path, rows, fmt="%.4f", delimiter=",", header="intensity,x,y,z", comments="")


def write_npy(path: Path) -> None:
    np.save(path, POINTS)


def write_parts(path: Path) -> None:
    path.mkdir()
    for number, part in enumerate((slice(0, 1500), slice(1500, None))):
        rows = np.c_[POINTS[part], BRIGHT[part]]
        np.savetxt(path / f"{number}.pts", rows, fmt="%.4f", header=str(len(rows)), comments="")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("map.ply", write_ply),
        ("map.pcd", write_pcd),
        ("map.las", write_las),
        ("map.laz", write_las),
        ("map.e57", write_e57),
        ("map.ptx", write_ptx),
        ("map.pts", write_pts),
        ("map.csv", write_csv),
        ("parts", write_parts),
    ],
)
def test_each_point_keeps_its_own(name: str, write: Callable[[Path], None], tmp_path: Path):
    write(tmp_path / name)
    found = read_map(tmp_path / name)
    assert found.points is not None
    assert found.intensity is not None
    assert len(found.intensity.values) == len(found.points)
    assert np.abs(found.intensity.values - wanted(found.points)).max() < 9  # each scan's own ends are cut
    assert found.intensity.low == pytest.approx(LOW, abs=2)


def test_a_map_without_it_has_none(tmp_path: Path):
    write_npy(tmp_path / "map.npy")
    assert read_map(tmp_path / "map.npy").intensity is None
    las = laspy.create(point_format=6, file_version="1.4")  # whose intensity is 0 where nobody wrote one
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = POINTS.T
    las.write(tmp_path / "map.las")
    assert read_map(tmp_path / "map.las").intensity is None


def test_recorded_scans_keep_the_mean_of_each_voxel(tmp_path: Path):
    posed = drive(24)
    folder = write_run(tmp_path, posed)
    scans = folder / "mapping_scans"
    (scans / "poses.csv").write_text((scans / "poses.csv").read_text().replace(".npy", ".ffscan"))
    for path, (scan, T) in zip(sorted(scans.glob("*.npy")), posed, strict=True):
        along = transform_points(T, scan)[:, 0]
        path.with_suffix(".ffscan").write_bytes(encode_scan(Scan.from_points(scan, intensity=7 * along)))
    found = read_map(folder)
    assert found.points is not None
    assert found.intensity is not None
    assert len(found.intensity.values) == len(found.points)
    low, high = found.intensity.low, found.intensity.high
    told = low + found.intensity.values * (high - low) / 255
    away = np.abs(told - np.clip(7 * found.points[:, 0], low, high))
    assert np.percentile(away, 99) < (high - low) / 255


@pytest.mark.parametrize("clean", [{}, {"voxel_m": 0.3}, {"voxel_m": None, "max_points": 1500}])
def test_the_points_of_a_build_are_the_same_with_and_without_it(clean: dict[str, object], tmp_path: Path):
    np.savetxt(tmp_path / "bare.xyz", POINTS, fmt="%.3f")
    np.savetxt(tmp_path / "bright.xyz", np.c_[POINTS, BRIGHT], fmt="%.3f")
    made = {}
    for name in ("bare", "bright"):
        out = tmp_path / name
        out.mkdir()
        config = BuildConfig.parse({"clean": {"min_neighbours": 1, **clean}, "level": True})
        write_level_map(tmp_path / f"{name}.xyz", None, config, out)
        made[name] = {path.name: path.read_bytes() for path in out.iterdir() if path.name != INTENSITY_FILE}
    assert made["bare"] == made["bright"]
    read = LevelMap("", tmp_path / "bright", "")
    assert LevelMap("", tmp_path / "bare", "").intensity is None
    assert read.intensity is not None
    assert len(read.intensity.values) == len(read.points)
    file_points = read.points @ read.T_map_level[:3, :3].T + read.T_map_level[:3, 3]
    away = np.abs(read.intensity.values - wanted(file_points))
    assert np.percentile(away, 90) < 4  # a voxel's mean of values that are cut at the ends
    assert cKDTree(POINTS).query(file_points)[0].max() < 1


def told_at(read: LevelMap) -> tuple[np.ndarray, np.ndarray]:
    """The points in the file's coordinates, and the intensity of each in the file's unit."""
    bright = read.intensity
    assert bright is not None
    points = transform_points(read.T_map_level, read.points)
    return points, bright.low + bright.values * (bright.high - bright.low) / 255


@pytest.mark.parametrize("is_bright", [True, False])
def test_merged_sessions_keep_it_where_all_of_them_have_one(tmp_path: Path, is_bright: bool):
    np.savetxt(tmp_path / "one.xyz", np.c_[POINTS, BRIGHT][:2500], fmt="%.3f")
    rows = np.c_[POINTS, BRIGHT] if is_bright else POINTS
    np.savetxt(tmp_path / "two.xyz", rows[1500:], fmt="%.3f")
    sessions = [{"source": "one.xyz"}, {"source": "two.xyz", "T_map_session": np.eye(4).tolist()}]
    (tmp_path / "sessions.yaml").write_text(json.dumps({"sessions": sessions}))
    with stages_below(tmp_path / "work", BuildConfig.parse({"clean": {"min_neighbours": 1}})) as stages:
        read = stages.read_map(tmp_path, None)
    if not is_bright:
        assert read.intensity is None
        return
    points, told = told_at(read)
    away = np.abs(told - (2 * points[:, 0] + 100))
    assert np.percentile(away, 90) < 1
