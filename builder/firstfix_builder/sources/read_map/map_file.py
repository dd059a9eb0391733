"""One map file, by its ending."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData, UnsupportedFormat
from firstfix.formats.file_kind import SNIFFED_BYTES, kind_of
from firstfix.formats.npy import read_npy
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.ply import decode_ply
from firstfix.formats.ply_header import parse_ply_header
from firstfix.formats.point_cloud import Body, Limits, PointCloud
from firstfix.formats.scanner_bin import decode_scanner_bin
from firstfix.formats.text import decode_text

from .e57 import read_e57
from .headers import check_ply
from .las_map import read_las_map
from .map_data import MapData, finite_cloud, finite_points
from .map_limits import LIMITS
from .mesh_file import read_mesh
from .octomap import read_octomap
from .pts import read_pts
from .ptx import read_ptx
from .rigid import rigid_matrices


def read_uos(path: Path) -> MapData:
    """One scan, in its own frame turned to REP-103 metres. Raises MalformedData or TooLarge."""
    x, y, z = decode_text(path.read_bytes(), LIMITS).xyz.T
    return MapData(points=finite_points(np.stack([z, -x, y], axis=1) / 100.0))


# How files of these endings begin.
_BEGINS = {
    ".las": b"LASF",
    ".laz": b"LASF",
    ".e57": b"ASTM-E57",
    ".glb": b"glTF",
    ".npy": b"\x93NUMPY",
}
# A row of numbers in these may be anything: points, poses, times.
TEXTS = (".xyz", ".csv", ".txt")
# Programs' own files, and what makes one of them that is read.
PROGRAMS = {
    ".db": "RTAB-Map's database: rtabmap-export --scan --poses_scan FILE.db writes FILE_cloud.ply and "
    "FILE_scan_poses.txt: give the folder of both",
    ".mm": "MOLA's metric map: mm2ply -i FILE.mm -b writes a PLY of each layer",
    ".simplemap": "MOLA's keyframes: sm2mm -i FILE.simplemap -o FILE.mm makes a map of them, and mm2ply -i "
    "FILE.mm -b writes a PLY of each of its layers",
    ".pbstream": "Cartographer's state: cartographer_assets_writer with the pipeline write_ply writes a PLY",
}
_CLOUDCOMPARE = (
    "CloudCompare's own file: CloudCompare -O FILE.bin -C_EXPORT_FMT PLY -SAVE_CLOUDS writes a PLY"
)
RECORDINGS = (".bag", ".db3", ".mcap", ".pcap", ".osf")
RECORDING_REASON = "a recording, not a map: build the map with a SLAM package first"


def read_map_file(path: Path) -> MapData:
    """A file to a map in its own frame, points finite.

    Raises:
        UnsupportedFormat: no reader for its ending.
        MalformedData, TooLarge: as its reader says.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None and path.suffix.lower() in RECORDINGS:
        raise UnsupportedFormat(RECORDING_REASON)
    foreign = named_program(path)
    if foreign:
        raise UnsupportedFormat(foreign)
    if reader is None:
        raise UnsupportedFormat(
            f"a file that ends in {path.suffix!r} cannot be read as a map; there are {' '.join(READERS)}"
        )
    if path.stat().st_size == 0:
        raise MalformedData("the file is empty (0 bytes)")
    _check_begin(path)
    data = reader(path)
    return data if data.read.form else replace(data, read=replace(data.read, form=path.suffix[1:].upper()))


def named_program(path: Path) -> str:
    """Remedy for a file that only its own program reads; empty if it is no such file."""
    ending = path.suffix.lower()
    if ending == ".bin":
        with path.open("rb") as file:
            return _CLOUDCOMPARE if file.read(4).startswith((b"CCB1", b"CCB2")) else ""
    return PROGRAMS.get(ending, "")


def _check_begin(path: Path) -> None:
    """Check that a file begins as files of its ending do; PCD and PLY are checked by their readers."""
    ending = path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(SNIFFED_BYTES)
    if ending in _BEGINS and not head.startswith(_BEGINS[ending]):
        raise MalformedData(f"{ending[1:].upper()}: the file does not begin as one: it is {kind_of(head)}")


def is_mesh_file(path: Path) -> bool:
    """Whether a map file is a mesh, from its ending or its header."""
    ending = path.suffix.lower()
    if ending != ".ply" or not path.stat().st_size:
        return READERS.get(ending) is read_mesh
    try:
        return parse_ply_header(_mapped(path)).count_of("face") > 0
    except MalformedData:
        return False


def _mapped(path: Path) -> memoryview:
    """The file's bytes without reading them: the decoders take views of what they need."""
    return memoryview(np.memmap(path, np.uint8, "r"))  # type: ignore[arg-type]


def _decoded(decode: Callable[[Body, Limits], PointCloud]) -> Callable[[Path], MapData]:
    return lambda path: _points(decode(_mapped(path), LIMITS))


def _points(cloud: PointCloud) -> MapData:
    points, intensity = finite_cloud(cloud)
    return MapData(points=points, intensity=intensity)


def _read_ply(path: Path) -> MapData:
    """A mesh when there are faces, else a cloud."""
    body = _mapped(path)
    header = parse_ply_header(body)
    if not header.count_of("face"):
        return _points(decode_ply(body, LIMITS))
    LIMITS.check("PLY", header.count_of("vertex") + header.count_of("face"), 24)
    check_ply(header, len(body))
    return read_mesh(path)


def _read_text(path: Path) -> MapData:
    cloud = decode_text(_mapped(path), LIMITS)
    if len(cloud) in (3, 4) and cloud.intensity is not None and _is_pose(np.c_[cloud.xyz, cloud.intensity]):
        raise MalformedData("a pose, not points: rows of 4 numbers that are a rigid transform")
    return _points(cloud)


def _read_asc(path: Path) -> MapData:
    """CloudCompare's text. Others call a raster of heights so."""
    with path.open("rb") as file:
        if file.read(5).lower() == b"ncols":
            raise UnsupportedFormat("an Esri ASCII grid, a raster of heights: it has no walls")
    return _read_text(path)


def _is_pose(matrix: NDArray[np.float64]) -> bool:
    try:
        rigid_matrices(matrix[None])
    except MalformedData:
        return False
    return True


READERS: dict[str, Callable[[Path], MapData]] = {
    ".pcd": _decoded(decode_pcd),
    ".ply": _read_ply,
    ".las": read_las_map,
    ".laz": read_las_map,
    ".e57": read_e57,
    ".xyz": _read_text,
    ".pts": read_pts,
    ".ptx": read_ptx,
    ".asc": _read_asc,
    ".csv": _read_text,
    ".txt": _read_text,
    ".npy": lambda path: _points(read_npy(path, LIMITS)),
    ".bin": lambda path: _points(decode_scanner_bin(_mapped(path), path.name, LIMITS)),
    ".3d": read_uos,
    ".bt": read_octomap,
    ".ot": read_octomap,
    ".obj": read_mesh,
    ".stl": read_mesh,
    ".glb": read_mesh,
}
