"""Text of scanners: PTX and PTS of several scans, and CloudCompare's .asc.

The PTX writer's file was read by MeshLab (pymeshlab 2025.7.post1): the same points, without those at 0 0 0.
CloudCompare 2.11 reads all blocks of a PTS, Open3D 0.20 the first.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, UnsupportedFormat
from firstfix.transform import from_quaternion, inverse, transform_points
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.what_was_read import LeftOut
from tests.every_case import every_case

ROOM = np.random.default_rng(3).uniform([-9, -7, 0], [9, 7, 3], (60, 3)).round(3)
STATION = from_quaternion([4.0, 2.0, 1.5], [0, 0, 0.3, 0.9])
OTHER = from_quaternion([-3.0, 1.0, 1.75], [0, 0, 1.0, 0.1])


def ptx(scans: list[tuple[np.ndarray, np.ndarray]], sizes: tuple[int, int] = (10, 6)) -> str:
    """Text of scans of 60 points in the file's frame, with T_map_scan."""
    lines: list[str] = []
    for points, T in scans:
        lines += [str(size) for size in sizes]
        rows = [T[:3, 3], T[:3, 0], T[:3, 1], T[:3, 2], *T.T]
        lines += [" ".join(f"{value:.9f}" for value in row) for row in rows]
        local = transform_points(inverse(T), points)
        local[5:11] = 0
        lines += [" ".join(f"{value:.9f}" for value in row) + " 0.5 10 20 30" for row in local]
    return "\n".join(lines) + "\n"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_scans_of_ptx_stand_where_their_matrices_say(tmp_path):
    data = read_map(write(tmp_path, "a.ptx", ptx([(ROOM, STATION), (ROOM + 1, OTHER)])))
    kept = np.delete(np.arange(60), np.arange(5, 11))
    np.testing.assert_allclose(data.points, np.concatenate([ROOM[kept], ROOM[kept] + 1]), atol=1e-6)
    np.testing.assert_allclose(data.trajectory, [STATION, OTHER], atol=1e-6)
    assert data.read.left_out == (LeftOut("points", "0 0 0: no light came back", 12),)
    data = read_map(write(tmp_path, "crlf.PTX", ptx([(ROOM, STATION)]).replace("\n", "\r\n")))
    assert len(data.points) == 54


def test_a_ptx_in_one_frame_has_no_station(tmp_path):
    data = read_map(write(tmp_path, "a.ptx", ptx([(ROOM, np.eye(4)), (ROOM + 1, np.eye(4))])))
    assert data.trajectory is None
    assert data.read.left_out[0].count == 2


GOOD = ptx([(ROOM, STATION)])


@every_case(
    ("text", "reason"),
    [
        (GOOD[: len(GOOD) // 2], "cut off: .* of 60 points of scan 1"),
        (GOOD + "10\n6\n0 0 0\n", "cut off in the head of scan 2"),
        ("1 2 3\n" * 20, "does not begin with its numbers of columns and of rows"),
        ("999999999\n999999999\n" + "1 2 3\n" * 20, "."),
        (ptx([(ROOM, 2 * STATION)]), "not a rigid transform"),
        ("0\n0\n" + "\n".join(GOOD.splitlines()[2:10]) + "\n", "its 1 scans have no points"),
    ],
)
def test_a_damaged_ptx_is_named(tmp_path, text, reason):
    with pytest.raises(InputError, match=rf"^a\.ptx: .*({reason})"):
        read_map(write(tmp_path, "a.ptx", text))


def block(points: np.ndarray) -> str:
    return f"{len(points)}\n" + "".join(f"{x:.3f} {y:.3f} {z:.3f} 12 1 2 3\n" for x, y, z in points)


def test_all_blocks_of_a_pts_are_read(tmp_path):
    for name, text in (
        ("two.pts", block(ROOM[:40]) + block(ROOM[40:])),
        ("gaps.pts", block(ROOM[:40]) + "\n" + block(ROOM[40:]) + "\n\n"),
        ("one.pts", block(ROOM)),
        ("none.pts", block(ROOM).partition("\n")[2]),
        ("empty_block.pts", block(ROOM[:40]) + "0\n" + block(ROOM[40:])),
    ):
        np.testing.assert_array_equal(read_map(write(tmp_path, name, text)).points, ROOM, err_msg=name)
    for text, reason in (
        (block(ROOM[:40]) + block(ROOM[40:])[:-90], "cut off: .* of 20 points of block 2"),
        (block(ROOM[:40]) + "1 2 3 4\n" * 9, "line 42 is '1 2 3 4', where the number of points of block 2"),
        (block(ROOM[:40])[:-60], "cut off"),
    ):
        with pytest.raises(MalformedData, match=reason):
            read_map(write(tmp_path, "a.pts", text))


def test_asc_is_cloudcompares_text_and_no_raster(tmp_path):
    rows = "//X Y Z Scalar\n60\n" + "".join(f"{x:.3f} {y:.3f} {z:.3f} 1.0\n" for x, y, z in ROOM)
    np.testing.assert_array_equal(read_map(write(tmp_path, "a.asc", rows)).points, ROOM)
    with pytest.raises(UnsupportedFormat, match="raster of heights"):
        read_map(write(tmp_path, "dem.asc", "ncols 4\nnrows 6\nxllcorner 0.0\n1 2 3 4\n"))
