"""Rows of float32 without a header: told right, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.errors import InputError, InvalidOption, MalformedData, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, PointCloud
from firstfix.formats.raw_xyz import MAX_COLUMNS, parse_columns
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.scan_file import read_cloud_file, read_scan_file
from firstfix.sensor import preset
from tests.every_case import every_case
from tests.needs import RECORDED, with_recorded

TURN_S = 0.1
NAMES = {
    "xyz": ("x", "y", "z"),
    "kitti": ("x", "y", "z", "intensity"),
    "kitti without intensity": ("x", "y", "z", "intensity"),
    "kitti in 255 levels": ("x", "y", "z", "intensity"),
    "nuscenes": ("x", "y", "z", "intensity", "ring"),
    "with times": ("x", "y", "z", "intensity", "time"),
    "boreas": ("x", "y", "z", "intensity", "ring", "time"),
    "velodyne-decoder": ("x", "y", "z", "intensity", "time", "column", "ring", "return_type"),
    "oxford": ("x", "y", "z", "intensity"),
}
UNKNOWN = ("with normals", "with colours", "with a normal after the intensity")
SHARE_TOLD = 0.99  # of real scans in their own order


def room(sensor: str = "hdl-32e", seed: int = 0) -> np.ndarray:
    """Points of a sensor in a box of 16 x 10 x 4 m, column by column, as nuScenes' files are."""
    rays = preset(sensor).directions().astype(np.float64)
    rays = rays[np.lexsort((rays[:, 2], -np.round(np.arctan2(rays[:, 1], rays[:, 0]), 3)))]
    rays[np.abs(rays) < 1e-9] = 1e-9
    walls = np.where(rays > 0, [8.0, 5.0, 3.0], [-8.0, -5.0, -1.0]) / rays
    ranges = walls.min(axis=1) + np.random.default_rng(seed).normal(0, 0.02, len(rays))
    return rays * ranges[:, None]


def rows_of(points: np.ndarray, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """The points in each layout, (n, m) float32; Oxford's are (4, n)."""
    n = len(points)
    range_m = np.linalg.norm(points, axis=1)
    level = np.round(np.clip(0.3 + 0.2 * np.sin(range_m) + 0.1 * rng.normal(size=n), 0, 1), 2)
    elevation = np.arcsin(np.clip(points[:, 2] / np.maximum(range_m, 1e-6), -1, 1))
    low, high = np.percentile(elevation, (1, 99))
    ring = np.clip(np.round((elevation - low) / max(high - low, 1e-3) * 31), 0, 31)
    turn = (np.pi - np.arctan2(points[:, 1], points[:, 0])) / (2 * np.pi)
    more = {
        "xyz": (),
        "kitti": (level,),
        "kitti without intensity": (np.zeros(n),),
        "kitti in 255 levels": (np.round(level * 255),),
        "nuscenes": (np.round(level * 255), ring),
        "with times": (level, turn * TURN_S),
        "boreas": (level, ring, (turn - 0.5) * TURN_S),
        "velodyne-decoder": (
            np.round(level * 255),
            (turn - 1) * TURN_S,
            np.round(turn * 1800),
            ring,
            np.ones(n),
        ),
        "oxford": (level,),
        "with normals": tuple(rng.normal(size=(3, n))),
        "with colours": tuple(rng.integers(0, 255, (3, n))),
        "with a normal after the intensity": (level, *rng.normal(size=(3, n))),
    }
    for name, columns in more.items():
        rows = np.column_stack([points, *columns]).astype("<f4")
        yield name, np.ascontiguousarray(rows.T) if name == "oxford" else rows


def told(rows: np.ndarray) -> tuple[str, ...] | None:
    """The columns that the decoder finds; None: it refuses. Fails where it takes others' numbers."""
    cloud = _decoded(rows)
    if cloud is None:
        return None
    by_column = rows.shape[0] == 4 and rows.shape[1] > 16
    right = (rows.T if by_column else rows)[:, :3]
    assert np.array_equal(cloud.xyz, right), f"{cloud.columns.keys()}, and not the points that were written"
    return tuple(cloud.columns)


@every_case("order", ["columns", "rings", "shuffled"])
def test_each_layout_of_a_simulated_scan_is_told(order):
    points = room()[: 32 * 1000]  # a multiple of every length of a row
    if order == "rings":
        points = points.reshape(-1, 32, 3).transpose(1, 0, 2).reshape(-1, 3)
    if order == "shuffled":
        points = np.random.default_rng(1).permutation(points)
    for name, rows in rows_of(points, np.random.default_rng(2)):
        assert told(rows) == NAMES.get(name), name


def _real_scans() -> Iterator[np.ndarray]:
    for path in sorted(RECORDED.rglob("*")):
        is_scan = path.suffix == ".pcd" or (path.suffix == ".laz" and path.parent.name == "queries")
        if is_scan and not ("map" in path.name or {"user_maps", "worlds"} & set(path.parts)):
            try:
                points = read_cloud_file(path).xyz
            except InputError:
                continue
            if len(points) > 500 and np.isfinite(points).all():
                yield points
    for path in sorted(RECORDED.rglob("*thin*.npz")):
        with np.load(path) as scans:
            unit_m = 0.01 if "_cm_" in path.name else 0.002
            yield from (scans[name] * unit_m for name in scans.files if scans[name].ndim == 2)


def _spoilt(points: np.ndarray, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """Points of rows as a scanner without returns in places, or with a narrow view, gives them."""
    yield "in front", points[points[:, 0] > 0]
    yield "few", points[:500]
    for share in (0.5, 0.9):
        lost = rng.random(len(points)) < share
        for name, value in (("zeros", 0.0), ("NaN", np.nan)):
            spoilt = points.copy()
            spoilt[lost] = value
            yield f"{share} {name}", spoilt


@every_case("seed", range(3))
def test_rows_with_few_returns_are_not_taken_for_those_of_another_layout(seed):
    rng = np.random.default_rng(seed)
    points = np.random.default_rng(seed + 10).permutation(room(seed=seed)[: 32 * 1000])
    points = points if seed else room()[: 32 * 1000]
    for name, rows in rows_of(points, rng):
        by_row = rows.T if name == "oxford" else rows
        for how, spoilt in _spoilt(by_row, rng):
            spoilt = np.ascontiguousarray(spoilt.T if name == "oxford" else spoilt, "<f4")
            cloud = _decoded(spoilt)
            if cloud is not None:
                right = (spoilt.T if name == "oxford" else spoilt)[:, :3]
                assert np.array_equal(cloud.xyz, right, equal_nan=True), f"{name}, {how}"


def _decoded(rows: np.ndarray) -> PointCloud | None:
    try:
        return decode_scanner_bin(rows.tobytes(), "scan.bin", SCAN_LIMITS)
    except UnsupportedFormat:
        return None


@with_recorded("kitti_drive0027_street")
@pytest.mark.parametrize("every", [12, pytest.param(1, marks=[pytest.mark.slow, pytest.mark.timeout(1200)])])
def test_no_layout_of_a_real_scan_is_told_wrong(every: int):
    rng = np.random.default_rng(3)
    right = tried = 0
    for points in list(_real_scans())[::every]:
        for name, rows in rows_of(points, rng):
            found = told(rows)
            assert found in (None, NAMES.get(name)), name
            tried += name in NAMES
            right += found is not None
    assert right >= SHARE_TOLD * tried


def test_the_columns_of_an_array_are_told_where_they_are_known(tmp_path: Path):
    points = room()[:3200]
    for name, rows in rows_of(points, np.random.default_rng(2)):
        if name == "oxford":
            continue
        np.save(tmp_path / "a.npy", rows)
        cloud = read_cloud_file(tmp_path / "a.npy")
        assert np.array_equal(cloud.xyz, rows[:, :3])
        assert tuple(cloud.columns) == NAMES.get(name, ("x", "y", "z", "intensity"))
        has_times = "time" in NAMES.get(name, ())
        assert (read_scan_file(tmp_path / "a.npy").time_s is not None) == has_times


@with_recorded("formats/original")
def test_a_real_file_of_kitti_is_the_same_to_the_bit():
    path = next((RECORDED / "formats" / "original").glob("kitti00_*.bin"))
    rows = np.fromfile(path, "<f4").reshape(-1, 4)
    cloud = read_cloud_file(path)
    assert list(cloud.columns) == ["x", "y", "z", "intensity"]
    assert all(np.array_equal(column, rows[:, k]) for k, column in enumerate(cloud.columns.values()))


def test_the_ending_of_nuscenes_tells_its_rows(tmp_path: Path):
    points = room()[:1000]
    rows = dict(rows_of(points, np.random.default_rng(2)))["nuscenes"]
    for name in ("a.pcd.bin", "a.bin"):
        rows.tofile(tmp_path / name)
        assert np.array_equal(read_cloud_file(tmp_path / name).ring, rows[:, 4])
    (tmp_path / "cut.pcd.bin").write_bytes(rows.tobytes()[:-4])
    with pytest.raises(MalformedData, match="not a whole number of rows of 20 bytes"):
        read_cloud_file(tmp_path / "cut.pcd.bin")


def test_columns_that_are_told_are_taken(tmp_path: Path):
    points = room()[:3000]
    turn_s = np.linspace(-0.1, 0, len(points))
    rows = np.column_stack([turn_s, points[:, [1, 0, 2]], np.full(len(points), 7)]).astype("<f4")
    path = tmp_path / "mine.bin"
    rows.tofile(path)
    with pytest.raises(UnsupportedFormat, match="rows of 5 numbers, whose columns are not known"):
        read_scan_file(path)
    names = "time,y,x,z,_"
    scans = [
        read_scan_file(path, parse_columns(names)),
        decode_query(path.read_bytes(), f'application/vnd.firstfix.xyzi; columns="{names}"'),
        decode_query(path.read_bytes(), f"application/vnd.firstfix.xyzi;COLUMNS={names.upper()}"),
    ]
    for scan in scans:
        np.testing.assert_array_equal(scan.points, points.astype(np.float32))
        np.testing.assert_allclose(scan.time_s, turn_s, atol=1e-6)
    with pytest.raises(MalformedData, match="not a whole number of rows of 28 bytes"):
        read_scan_file(path, ("x", "y", "z", "_", "_", "_", "_"))
    path.rename(tmp_path / "mine.pcd")
    with pytest.raises(InvalidOption, match=r"for \.bin"):
        read_scan_file(tmp_path / "mine.pcd", parse_columns(names))


@every_case(
    "text",
    [
        "",
        "x,y",
        "x,y,z,x",
        "x y z",
        "x,y,z,;",
        "x,y,z," + "a" * 50,
        ",".join(["x", "y", "z"] + ["_"] * MAX_COLUMNS),
    ],
)
def test_columns_that_are_none_are_refused(text):
    with pytest.raises(InvalidOption, match="columns"):
        parse_columns(text)


@every_case("seed", range(20))
def test_random_bytes_are_refused_or_read(seed):
    rng = np.random.default_rng(seed)
    body = rng.integers(0, 256, 4 * int(rng.integers(1, 2000)), dtype=np.uint8).tobytes()
    with suppress(InputError):
        assert len(decode_scanner_bin(body, "a.bin", SCAN_LIMITS)) > 0
