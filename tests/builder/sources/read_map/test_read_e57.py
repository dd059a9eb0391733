"""E57: which poses are stations, and poses by the names of their numbers (ASTM E2807, table of Pose)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pye57
import pytest

from firstfix.transform import from_quaternion, inverse, quaternion_of, transform_points
from firstfix_builder.sources.read_map import MapData, read_map
from tests.every_case import every_case
from tests.hostile_files import E57_PAGE, e57_checksums

UTM = np.array([512_345.6, 5_403_210.1, 295.5])
AT = np.array([3.0, -2.0, 1.1])  # a scanner in the room, 1.1 m above its floor
IDENTITY = np.eye(4)
TURN = [0.1, 0.2, 0.3, 0.9]


def room(spacing_m: float = 0.15) -> np.ndarray:
    """(n, 3) points of a box of 16 x 12 x 3 m around the origin, its floor at 0."""
    x, y, z = np.arange(-8, 8, spacing_m), np.arange(-6, 6, spacing_m), np.arange(0, 3, spacing_m)
    walls = [np.stack(np.meshgrid(a, b), -1).reshape(-1, 2) for a, b in ((x, z), (y, z), (x, y))]
    along, across, level = walls
    parts = [np.c_[along[:, 0], np.full(len(along), side), along[:, 1]] for side in (-6.0, 6.0)]
    parts += [np.c_[np.full(len(across), side), across] for side in (-8.0, 8.0)]
    return np.concatenate(
        [*parts, np.c_[level, np.zeros(len(level))], np.c_[level, np.full(len(level), 3.0)]]
    )


ROOM = room()


def write(path: Path, scans: list[tuple[np.ndarray, np.ndarray | None]]) -> Path:
    """Scans in the file's frame with their poses; None writes what pye57 writes of itself: the identity."""
    file = pye57.E57(str(path), mode="w")
    for points, T in scans:
        local = points if T is None else transform_points(inverse(T), points)
        columns = {f"cartesian{axis}": np.ascontiguousarray(local[:, i]) for i, axis in enumerate("XYZ")}
        if T is None:
            file.write_scan_raw(columns)
            continue
        q = quaternion_wxyz(T)
        file.write_scan_raw(columns, rotation=q, translation=T[:3, 3])
    file.close()
    return path


def quaternion_wxyz(T: np.ndarray) -> np.ndarray:
    return np.roll(quaternion_of(T), 1)


def reordered(path: Path, name: str, order: str) -> Path:
    """The file with the children of each pose's structure in another order; they keep their values."""
    raw = path.read_bytes()
    place, length = int.from_bytes(raw[24:32], "little"), int.from_bytes(raw[32:40], "little")
    data = E57_PAGE - 4
    pages = [raw[at : at + E57_PAGE] for at in range(0, len(raw), E57_PAGE)]
    body = b"".join(page[:data] for page in pages)
    first = place // E57_PAGE * data + place % E57_PAGE
    xml = body[first : first + length]

    def swap(found: re.Match[bytes]) -> bytes:
        children = {child[1]: child[0] for child in re.finditer(rb"\s*<(\w) .*?(?:/>|</\w>)", found[2])}
        return found[1] + b"".join(children[one.encode()] for one in order) + found[3]

    pattern = rf'(<{name} type="Structure">)(.*?)(\s*</{name}>)'.encode()
    changed = re.sub(pattern, swap, xml, flags=re.DOTALL)
    assert len(changed) == len(xml)
    assert changed != xml
    body = body[:first] + changed + body[first + length :]
    paged = b"".join(body[at : at + data] + b"\0" * 4 for at in range(0, len(body), data))
    path.write_bytes(e57_checksums(paged))
    return path


def at(x: float, y: float, z: float) -> np.ndarray:
    return from_quaternion([x, y, z], [0, 0, 0, 1])


def turned(x: float, y: float, z: float) -> np.ndarray:
    return from_quaternion([x, y, z], [0, 0, 0.6, 0.8])


SCANNER = from_quaternion(AT, TURN)
OTHER = from_quaternion([-4.0, 3.0, 1.2], [0.0, 0.0, 1.0, 0.2])
CORNER = ROOM + [8.0, 6.0, 0.0]
IS_IDENTITY, SHIFTED, SHARED = "the identity", "no turn, and a shift", "all scans have the same"
# The file, how many of its poses are stations, and the reasons for the others. Merged files: pye57 0.4.19
# writes the identity where none is given, CloudCompare 2.13 its global shift (of all coordinates).
STATIONS = {
    "a scanner": ([(ROOM, SCANNER)], 1, ""),
    "two scanners": ([(ROOM, SCANNER), (ROOM, OTHER)], 2, ""),
    "two scanners at UTM": ([(ROOM + UTM, at(*UTM + AT)), (ROOM + UTM, at(*UTM + [1, 2, 1]))], 2, ""),
    "the first scanner is the frame": ([(ROOM - AT, IDENTITY), (ROOM - AT, OTHER)], 2, ""),
    "merged": ([(ROOM, None)], 0, IS_IDENTITY),
    "merged, in the middle of the room": ([(ROOM - AT, IDENTITY)], 0, IS_IDENTITY),
    "merged, two of pye57": ([(ROOM, None), (CORNER, None)], 0, IS_IDENTITY),
    "shift of CloudCompare": ([(CORNER + UTM, at(512_300, 5_403_200, 0))], 0, SHIFTED),
    "shift inside the room": ([(ROOM + [100, 200, -1], at(100, 200, 0))], 0, SHIFTED),
    "tiles, each about its middle": (
        [(ROOM[ROOM[:, 0] < 0], at(-4, 0, 1)), (ROOM[ROOM[:, 0] >= 0], at(4, 0, 1))],
        0,
        SHIFTED,
    ),
    "shift to the corner, no whole metres": ([(CORNER, at(0.25, 0.75, 0.5))], 0, SHIFTED),
    "shift to the middle, no whole metres": ([(ROOM, at(0.37, -1.21, 1.13))], 0, SHIFTED),
    "tiles from their corners": (
        [(ROOM[ROOM[:, 0] < 0], at(*ROOM.min(axis=0))), (CORNER + 0.25, at(*CORNER.min(axis=0) + 0.25))],
        0,
        "outside the scan's own points",
    ),
    "shared by two": ([(ROOM, SCANNER), (ROOM[::2], SCANNER)], 0, SHARED),
    "corner of the floor": ([(CORNER, turned(0.5, 0.5, 0.0))], 0, "outside the scan's own points"),
    "on the floor": ([(ROOM, turned(0.5, 0.5, 0.05))], 0, ""),
    "outside a wall": ([(ROOM, turned(15.5, 0.5, 1.0))], 0, "outside the scan's own points"),
    "under the floor": ([(ROOM, turned(1.5, 0.5, -0.4))], 0, "outside the scan's own points"),
    "one of two": ([(ROOM, SCANNER), (ROOM, at(15.5, 0.5, 1.0))], 1, "outside the scan's own points"),
}


@every_case("scans, stations, reason", STATIONS.values(), ids=list(STATIONS))
def test_a_pose_is_a_station_where_it_can_be_one(tmp_path, scans, stations, reason):
    data = read_map(write(tmp_path / "map.e57", scans))
    found = 0 if data.trajectory is None else len(data.trajectory)
    assert found == stations
    left_out = data.read.left_out
    assert sum(one.count for one in left_out) == len(scans) - stations
    assert all(reason in one.reason for one in left_out)
    whole = np.concatenate([points for points, _ in scans])
    np.testing.assert_allclose(in_file(data), whole, atol=1e-6)


def in_file(data: MapData) -> np.ndarray:
    assert data.points is not None
    return data.points + data.origin


@pytest.mark.parametrize(
    ("name", "order"), [("rotation", "xyzw"), ("rotation", "zwyx"), ("translation", "zyx")]
)
def test_the_numbers_of_a_pose_go_by_their_names(tmp_path, name, order):
    path = write(tmp_path / "map.e57", [(ROOM, SCANNER), (ROOM, OTHER)])
    data = read_map(reordered(path, name, order))
    np.testing.assert_allclose(data.points, np.concatenate([ROOM, ROOM]), atol=1e-6)
    np.testing.assert_allclose(data.trajectory, [SCANNER, OTHER], atol=1e-6)


def write_spherical(path: Path, columns: dict[str, np.ndarray]) -> None:
    """One scan without a pose, as scanners measure: pye57 writes x y z alone."""
    file = pye57.E57(str(path), mode="w")
    image, lib = file.image_file, pye57.libe57
    prototype = lib.StructureNode(image)
    for name in columns:
        prototype.set(name, lib.FloatNode(image, 0.0, lib.E57_DOUBLE, -1e9, 1e9))
    points = lib.CompressedVectorNode(image, prototype, lib.VectorNode(image, True))
    scan = lib.StructureNode(image)
    scan.set("guid", lib.StringNode(image, "{0}"))
    scan.set("name", lib.StringNode(image, "from the door"))
    scan.set("points", points)
    file.data3d.append(scan)
    count = len(next(iter(columns.values())))
    arrays, buffers = file.make_buffers(list(columns), count)
    for name, column in columns.items():
        arrays[name][:] = column
    writer = points.writer(buffers)
    writer.write(count)
    writer.close()
    file.close()


def test_spherical_points_and_what_was_read(tmp_path):
    local = ROOM - AT
    range_m = np.linalg.norm(local, axis=1)
    columns = {
        "sphericalRange": range_m,
        "sphericalAzimuth": np.arctan2(local[:, 1], local[:, 0]),
        "sphericalElevation": np.arcsin(local[:, 2] / range_m),
    }
    write_spherical(tmp_path / "map.e57", columns)
    data = read_map(tmp_path / "map.e57")
    np.testing.assert_allclose(data.points, local, atol=1e-9)
    assert (data.read.form, data.read.clouds) == ("E57", ("from the door",))
    assert data.trajectory is None
