"""Reads files of poses. Name, header and number of columns show the format."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, TooLarge
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.point_cloud import MAP_LIMITS
from firstfix.formats.text_table import MAX_LINE_BYTES, is_number, parse_rows

from .file_errors import naming
from .pose_columns import PoseColumns, columns_of, poses_of
from .rigid import are_unit, rigid_from_angles, rigid_from_quaternions, rigid_matrices

MAX_TRAJECTORY_BYTES = 500_000_000
G2O_POSE = "VERTEX_SE3:QUAT"
_SNIFFED_BYTES = 65_536
_NAMED = "tx, ty, tz, qx, qy, qz, qw"
_COMMENT = ("#", "%", "//")
_COMMENTS = re.compile(rb"(?:#|%|//)[^\r\n]*")  # people write their own language in them
_BETWEEN = re.compile(r"[\W_]+")
_W_FIRST = re.compile(r"\bq? ?w ?q? ?x ?q? ?y ?q? ?z\b", re.IGNORECASE)  # with one space for all between


def read_trajectory(path: Path) -> NDArray[np.float64]:
    """T_map_sensor, (m, 4, 4), m >= 1, in the order of the file.

    A line that names the columns, as a comment or not, decides their order. Without one:

    | file | rows |
    |---|---|
    | TUM | t x y z qx qy qz qw; also with a number behind (RTAB-Map), or sec nsec before (Newer College) |
    | KITTI | the 12 numbers of a 3x4 matrix, or the 16 of a 4x4 one; also with a time or a frame before |
    | a single pose | 3 or 4 rows of 4: the matrix itself |
    | key_frame.txt of Livox LOAM | qx qy qz qw tx ty tz |
    | pose.json (it is no JSON) | tx ty tz qw qx qy qz |
    | g2o | VERTEX_SE3:QUAT id x y z qx qy qz qw, by the ids |
    | PCD (LIO-SAM's transformations.pcd) | x y z with roll pitch yaw; without them no turn at all |

    Raises:
        NotFound: no such file.
        MalformedData: none of these, damaged or empty; the message names the file.
        TooLarge: over 500 MB.
    """
    path = Path(path)
    with naming(path):
        size = path.stat().st_size
        if size > MAX_TRAJECTORY_BYTES:
            raise TooLarge(f"{size} bytes, the limit is {MAX_TRAJECTORY_BYTES}")
        raw = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
        if not raw.strip():
            raise MalformedData("poses: the file is empty")
        if path.suffix.lower() == ".pcd":
            poses = _from_pcd(raw)
        elif raw.lstrip().startswith(G2O_POSE.encode()) or path.suffix.lower() == ".g2o":
            poses = _from_g2o(raw)
        else:
            poses = _from_text(raw, path.name)
        if not len(poses):
            raise MalformedData("poses: the file has no pose")
        return poses


def _from_pcd(raw: bytes) -> NDArray[np.float64]:
    cloud = decode_pcd(raw, MAP_LIMITS)
    if {"roll", "pitch", "yaw"} <= set(cloud.columns):
        angles = np.stack([cloud.columns[name] for name in ("roll", "pitch", "yaw")], axis=1)
        return rigid_from_angles(cloud.xyz, angles.astype(np.float64))
    return rigid_from_angles(cloud.xyz, np.zeros((len(cloud), 3)))


def _from_g2o(raw: bytes) -> NDArray[np.float64]:
    mark = G2O_POSE.encode()
    lines = [line[len(mark) :] for line in raw.splitlines() if line.startswith(mark)]
    rows = parse_rows("poses", b"\n".join(lines))
    if not len(rows):
        return np.empty((0, 4, 4))
    if rows.shape[1] != 8:
        raise MalformedData(f"poses: {G2O_POSE} with {rows.shape[1]} numbers instead of 8")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return poses_of(rows[:, 1:])


def _from_text(raw: bytes, file_name: str) -> NDArray[np.float64]:
    """By the names of the columns, or by the number of them."""
    named: PoseColumns | None = None
    says_w_first = False
    delimiter = None
    for line in _first_lines(raw):
        delimiter = next((mark for mark in ",;" if mark in line), None)
        is_comment = line.startswith(_COMMENT)
        found = columns_of(line.lstrip("#%/ \t"), delimiter)
        if is_comment:
            named = found or named
            says_w_first |= found is None and _W_FIRST.search(_BETWEEN.sub(" ", line)) is not None
        elif found is not None:
            return _from_table(raw, delimiter, found, names_above=1)
        else:
            words = line.split(delimiter)
            if named is not None and len(words) == named.width and not all(map(is_number, words)):
                return _from_table(raw, delimiter, named, names_above=0)
            if len(words) > 1 and not any(map(is_number, words)):
                raise MalformedData(f"poses: {line[:80]!r}, the line of names, does not name {_NAMED}")
            break
    rows = parse_rows("poses", _COMMENTS.sub(b"", raw), delimiter=delimiter)
    if named is not None and len(rows) and rows.shape[1] == named.width:
        return named.poses(rows)
    # the width alone would misread what is named in another order, such as w first
    if named is not None and len(rows) and list(named.places) != sorted(named.places):
        raise MalformedData(
            f"poses: a comment names {named.width} columns, and the rows have {rows.shape[1]} numbers"
        )
    if named is None and says_w_first:
        raise MalformedData(
            "poses: a comment says that w is the quaternion's first number: name all columns in one line, as "
            "# timestamp x y z qw qx qy qz"
        )
    return _by_width(rows, file_name)


def _first_lines(raw: bytes) -> Iterator[str]:
    """The comments before the first row, and that row."""
    for line in raw[:_SNIFFED_BYTES].decode("latin-1").splitlines():
        text = line.strip()
        if text:
            yield text
        if text and not text.startswith(_COMMENT):
            return


def _from_table(
    raw: bytes, delimiter: str | None, columns: PoseColumns, *, names_above: int
) -> NDArray[np.float64]:
    """Rows below the line of names, if it is no comment. Those with an empty pose are "not in this map"."""
    try:
        lines = raw.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise MalformedData(f"poses: {error}") from error
    if any(len(line) > MAX_LINE_BYTES for line in lines):
        raise MalformedData(f"poses: a line is longer than {MAX_LINE_BYTES} bytes")
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith(_COMMENT)][names_above:]
    try:
        table = list(csv.reader(rows, delimiter=delimiter)) if delimiter else [row.split() for row in rows]
    except csv.Error as error:
        raise MalformedData(f"poses: {error}") from error
    if table and all(len(row) == 1 for row in table):
        between = "spaces" if delimiter is None else repr(delimiter)
        raise MalformedData(f"poses: the line of names has {between} between its columns, and no row has")
    numbers = []
    for number, row in enumerate((row for row in table if row), start=1):
        words = [row[place].strip() if place < len(row) else "" for place in columns.places]
        if not any(words) or columns.is_landmark(row):
            continue
        try:
            numbers.append([float(word) for word in words])
        except ValueError as error:
            raise MalformedData(f"poses: row {number}: {error}") from error
    return poses_of(np.array(numbers).reshape(-1, len(columns.places)))


def _by_width(rows: NDArray[np.float64], file_name: str) -> NDArray[np.float64]:
    """Poses of rows without names."""
    if not len(rows):
        return np.empty((0, 4, 4))
    columns = rows.shape[1]
    if columns in (13, 17):  # KITTI-360's frame, or a time
        rows, columns = rows[:, 1:], columns - 1
    if columns in (12, 16):
        return rigid_matrices(rows.reshape(len(rows), -1, 4))
    if columns == 4 and len(rows) in (3, 4):
        return rigid_matrices(rows[None])
    if columns == 8:
        return poses_of(rows[:, 1:])
    if columns == 9 and are_unit(rows[:, 4:8]) != are_unit(rows[:, 5:]):
        return poses_of(rows[:, 1:8] if are_unit(rows[:, 4:8]) else rows[:, 2:])
    if columns == 7 and file_name.lower() == "pose.json":
        return rigid_from_quaternions(rows[:, :3], rows[:, [4, 5, 6, 3]])
    if columns == 7 and (file_name.lower() == "key_frame.txt" or not are_unit(rows[:, 3:])):
        return rigid_from_quaternions(rows[:, 4:], rows[:, :4])
    if columns == 7:
        return poses_of(rows)
    raise MalformedData(
        f"poses: rows of {columns} numbers are neither TUM's (8), KITTI's (12) nor Livox's (7): write a "
        f"first line that names {_NAMED}"
    )
