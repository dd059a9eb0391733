"""Wrong inputs, each made from a right scan: what users send by mistake."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.scan.scan import Scan
from tests.small_world import SmallWorld

Points = NDArray[np.float64]


MAP_POINTS = 250_000
FAR_M = 5.0  # from the map's origin, or a scan in the map's frame has its place at the sensor's


@dataclass(frozen=True)
class RightScan:
    """The scan that the wrong inputs are made from.

    Attributes:
        points: (n, 3) in the sensor frame.
        T_map_sensor: (4, 4) where it was taken.
        map_points: (m, 3) of the map.
    """

    points: Points
    T_map_sensor: NDArray[np.float64]
    map_points: Points

    @classmethod
    def of(cls, world: SmallWorld, scans: Iterable[tuple[Scan, NDArray[np.float64]]]) -> RightScan:
        """The first scan of a world that is far enough from the map's origin.

        Args:
            scans: each with its ``T_map_sensor``.
        """
        import trimesh

        scan, T = next(one for one in scans if np.linalg.norm(one[1][:2, 3]) > FAR_M)
        mesh = trimesh.Trimesh(world.vertices, world.triangles, process=False)
        map_points, _ = trimesh.sample.sample_surface(mesh, MAP_POINTS, seed=1)
        return cls(scan.points.astype(np.float64), T, map_points)

    @property
    def in_map(self) -> Points:
        T = self.T_map_sensor
        return self.points @ T[:3, :3].T + T[:3, 3]

    @property
    def range_m(self) -> NDArray[np.float64]:
        return np.linalg.norm(self.points, axis=1)

    @property
    def down(self) -> NDArray[np.float64]:
        return self.T_map_sensor[:3, :3].T @ [0.0, 0.0, -1.0]


@dataclass(frozen=True)
class WrongInput:
    """One wrong input.

    Attributes:
        name: what is wrong.
        file: name of the file that is given to the command line; its ending is the format.
        content: bytes of the file.
        options: of the query.
        by_http: it has a media type.
    """

    name: str
    file: str
    content: Callable[[RightScan], bytes]
    options: Callable[[RightScan], Mapping[str, str]] = field(default=lambda right: {})
    by_http: bool = True


def kitti(points: Points, intensity: NDArray[np.float64] | float = 0.0) -> bytes:
    """Rows of four float32."""
    rows = np.empty((len(points), 4), "<f4")
    with np.errstate(over="ignore"):
        rows[:, :3], rows[:, 3] = points, intensity
    return rows.tobytes()


def ply(points: Points) -> bytes:
    """Points as doubles."""
    names = "".join(f"property double {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{names}end_header\n"
    return head.encode() + np.asarray(points, "<f8").tobytes()


def npy(array: NDArray[np.generic], *, pickled: bool = False) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=pickled)
    return file.getvalue()


def text(points: Points, separator: str, point: str = ".") -> bytes:
    rows = (separator.join(f"{v:.3f}".replace(".", point) for v in row) for row in points[:1000])
    return "\n".join(rows).encode()


def pcd(rows: str) -> bytes:
    count = rows.count("\n")
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    return f"{head}WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA ascii\n{rows}".encode()


def changed(name: str, change: Callable[[RightScan], Points]) -> WrongInput:
    """A scan with other points."""
    return WrongInput(name, "scan.ply", lambda right: ply(change(right)))


def with_option(name: str, option: str, value: Callable[[RightScan], NDArray[np.float64]]) -> WrongInput:
    """The right scan with a wrong option."""
    return WrongInput(
        name,
        "scan.ply",
        lambda right: ply(right.points),
        lambda right: {option: ",".join(f"{v:.6f}" for v in value(right))},
    )


def a_file(name: str, file: str, content: bytes, *, by_http: bool = True) -> WrongInput:
    """A file that is no scan."""
    return WrongInput(name, file, lambda right: content, by_http=by_http)


def _ring(right: RightScan, elevation_deg: float) -> Points:
    """The ring at an elevation of the sensor, whose rings are 2 degrees apart."""
    elevation = np.degrees(np.arcsin(right.points[:, 2] / right.range_m))
    return right.points[np.abs(elevation - elevation_deg) < 0.5]


def _polar(right: RightScan) -> Points:
    x, y, z = right.points.T
    return np.column_stack([right.range_m, np.arctan2(y, x), np.arcsin(z / right.range_m)])


def _noise(right: RightScan) -> Points:
    return np.random.default_rng(3).uniform(-10, 10, (20_000, 3))


_PNG = b"\x89PNG\r\n\x1a\n" + bytes(200)
_UTM = np.array([450_000.0, 5_200_000.0, 300.0])
_UPRIGHT = "0,0,1,0,0,0,1"

WRONG_INPUTS = (
    changed("in millimetres", lambda right: right.points * 1000),
    changed("in centimetres", lambda right: right.points * 100),
    changed("a hundredth of the size", lambda right: right.points * 0.01),
    changed("in feet", lambda right: right.points / 0.3048),
    changed("a tenth too large", lambda right: right.points * 1.1),
    changed("no points", lambda right: right.points[:0]),
    changed("one point", lambda right: right.points[:1]),
    changed("20 points", lambda right: right.points[rows_by_chance(len(right.points), 20)]),
    changed("all NaN", lambda right: right.points * np.nan),
    changed("all infinite", lambda right: right.points + np.inf),
    changed("all (0, 0, 0)", lambda right: right.points * 0),
    changed("only the robot itself", lambda right: right.points / right.range_m[:, None] * 0.6),
    changed("a 2-D LiDAR's scan", lambda right: _ring(right, 1.0) * [1, 1, 0]),
    changed("one ring", lambda right: _ring(right, -5.0)),
    changed("in UTM", lambda right: right.in_map + _UTM),
    changed("in the map's frame", lambda right: right.in_map),
    changed("in a frame 10 m away", lambda right: right.points + [8.0, -6.0, 0.0]),
    changed("the whole map", lambda right: right.map_points),
    changed("mirrored in x", lambda right: right.points * [-1, 1, 1]),
    changed("mirrored in y", lambda right: right.points * [1, -1, 1]),
    changed("mirrored in z", lambda right: right.points * [1, 1, -1]),
    changed("x and y swapped", lambda right: right.points[:, [1, 0, 2]]),
    WrongInput(
        "intensity first",
        "scan.bin",
        lambda right: kitti(
            np.column_stack([np.arange(len(right.points)) % 97, right.points[:, :2]]), right.points[:, 2]
        ),
    ),
    changed("range and angles", _polar),
    WrongInput(
        "an array (3, n), raw", "scan.ply", lambda right: ply(right.points[:9000].T.copy().reshape(-1, 3))
    ),
    WrongInput("an array (3, n)", "scan.npy", lambda right: npy(right.points.T.copy()), by_http=False),
    changed("random points", _noise),
    with_option("gravity with the wrong sign", "gravity", lambda right: -9.81 * right.down),
    with_option("gravity of another frame", "gravity", lambda right: right.down[[2, 0, 1]]),
    with_option(
        "a prior at the wrong place",
        "prior",
        lambda right: np.append(np.array([0.0, 0.0, 0.8]) - right.T_map_sensor[:3, 3] * [1, 1, 0], 1.0),
    ),
    WrongInput(
        "head down, said to be upright",
        "scan.ply",
        lambda right: ply(right.points * [1, -1, -1]),
        lambda right: {"T_base_sensor": _UPRIGHT},
    ),
    changed("y up", lambda right: right.points[:, [1, 2, 0]]),
    a_file("an empty file", "scan.pcd", b""),
    a_file("a PNG named .pcd", "scan.pcd", _PNG),
    a_file("text named .pcd", "scan.pcd", b"Dear all,\nthe scan is attached.\n"),
    a_file("a PNG named .ply", "scan.ply", _PNG),
    a_file("commas in an ascii PCD", "scan.pcd", pcd("1.5,2.5,0.5\n1.6,2.5,0.5\n")),
    a_file("a row with too few numbers", "scan.pcd", pcd("1.5 2.5 0.5\n1.6 2.5\n")),
    a_file("a PNG", "scan.png", _PNG, by_http=False),
    a_file("no ending", "scan", b"1 2 3\n", by_http=False),
    a_file("a PNG named .npy", "scan.npy", _PNG, by_http=False),
    WrongInput(
        "an array of objects",
        "scan.npy",
        lambda right: npy(np.array([[1, 2, None]], object), pickled=True),
        by_http=False,
    ),
    WrongInput("decimal commas", "scan.csv", lambda right: text(right.points, ";", ","), by_http=False),
    a_file("a header of other names", "scan.csv", b"a,b,c\n1,2,3\n", by_http=False),
    WrongInput("rows of five numbers (nuScenes)", "scan.bin", lambda right: bytes(20 * 999)),
)


def written(wrong: WrongInput, right: RightScan, folder: Path) -> Path:
    """Writes the file of a wrong input, and returns its path."""
    path = folder / wrong.file
    with np.errstate(invalid="ignore"):
        path.write_bytes(wrong.content(right))
    return path
