"""Files of every format that a reader takes: small good ones, to be damaged, and what reads them."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from firstfix.decode import decode_query
from firstfix.formats.laz_chunks import check_las
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.recording.recording import open_recording
from firstfix.scan_file import read_scan_file
from firstfix.transform import from_quaternion
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.archive import unpack
from tests.builder.sources.read_map import program_folders
from tests.hostile_bodies import good_bodies, pcd, ply
from tests.ros_samples import cloud_of_points, stores_of, write_bag

_POINTS = 120
E57_PAGE = 1024


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        make: writes good files into a folder, each with the ending that its reader knows.
        read: reads one; it raises nothing but a FirstfixError.
        repair: makes the checksums of a damaged file right again, so that a reader goes on.
        wounded: name of the file that is damaged where a good file is a folder.
    """

    make: Callable[[Path], None]
    read: Callable[[Path], object]
    repair: Callable[[bytes], bytes] | None = None
    wounded: str = ""


def xyz(seed: int = 0) -> NDArray[np.float64]:
    """(n, 3) points of a room, metres."""
    return np.random.default_rng(seed).uniform(-20, 20, (_POINTS, 3)).round(3)


def _las(folder: Path) -> None:
    import laspy

    for version, point_format in (("1.2", 1), ("1.2", 3), ("1.4", 6), ("1.4", 8)):
        las = laspy.create(point_format=point_format, file_version=version)
        las.header.scales = [0.001] * 3
        las.x, las.y, las.z = xyz().T
        las.gps_time = np.linspace(0, 0.1, _POINTS)
        las.add_extra_dim(laspy.ExtraBytesParams("range", np.float32))
        if version == "1.4":
            las.header.evlrs = laspy.vlrs.vlrlist.VLRList()
            las.evlrs.append(laspy.VLR("firstfix", 7, "a note", bytes(40)))
        las.write(folder / f"{point_format}.las")


def _read_las_scan(path: Path) -> None:
    """Read a scan as the command line does, in a process that has limits anyway."""
    check_las(path, SCAN_LIMITS, 8 * 5)
    read_scan_file(path)


def _laz(folder: Path) -> None:
    for point_format in (1, 3):
        _write_laz(folder / f"{point_format}.laz", point_format, variable=False)
    for point_format in (6, 7):
        _write_laz(folder / f"{point_format}.laz", point_format, variable=True)
        _write_laz(folder / f"{point_format} alone.laz", point_format, variable=False)


def _copc(folder: Path) -> None:
    for point_format in (6, 7, 8):
        _write_laz(folder / f"{point_format}.copc.laz", point_format, variable=True, is_copc=True)


def _write_laz(path: Path, point_format: int, *, variable: bool, is_copc: bool = False) -> None:
    """A LAZ file; with variable chunks, as COPC has them, it has several."""
    import laspy
    import lazrs

    las = laspy.create(point_format=point_format, file_version="1.4" if point_format >= 6 else "1.2")
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = xyz().T
    las.intensity = np.arange(_POINTS)
    if is_copc:
        las.header.vlrs.append(laspy.VLR("copc", 1, "COPC info", np.arange(20.0).tobytes()))
        las.header.evlrs = laspy.vlrs.vlrlist.VLRList()
        las.header.evlrs.append(laspy.VLR("copc", 1000, "COPC hierarchy", bytes(32 * 3)))
    if not variable:
        las.write(path)
        return
    packing = lazrs.LazVlr.new_for_compression(point_format, 0, True)
    las.header.vlrs.append(laspy.vlrs.known.LasZipVlr(bytes(packing.record_data())))
    las.header.are_points_compressed = True
    las.update_header()
    with path.open("wb+") as file:
        las.header.write_to(file)
        packer = lazrs.LasZipCompressor(file, packing)
        packer.reserve_offset_to_chunk_table()
        for part in np.array_split(las.points.array, 4):
            packer.compress_many(np.frombuffer(part.tobytes(), np.uint8))
            packer.finish_current_chunk()
        packer.done()
        if is_copc:
            start = file.seek(0, io.SEEK_END)
            las.header.evlrs.write_to(file, as_extended=True)
            las.header.start_of_first_evlr, las.header.number_of_evlrs = start, 1
            file.seek(0)
            las.header.write_to(file, ensure_same_size=True)


def _e57(folder: Path) -> None:
    import pye57

    file = pye57.E57(str(folder / "two scans.e57"), mode="w")
    for number in range(2):
        T = from_quaternion([1.0, 2.0, number], [0.0, 0.0, 0.0, 1.0])
        columns = {f"cartesian{axis}": xyz(number)[:, i].copy() for i, axis in enumerate("XYZ")}
        file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=T[:3, 3])
    file.close()


def e57_checksums(data: bytes) -> bytes:
    """Right checksums for all whole pages: CRC-32C, at the end of each."""
    pages = [data[start : start + E57_PAGE] for start in range(0, len(data), E57_PAGE)]
    return b"".join(
        page[:-4] + _crc32c(page[:-4]).to_bytes(4, "big") if len(page) == E57_PAGE else page for page in pages
    )


def _crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _CRC32C[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


def _crc_of_byte(value: int) -> int:
    for _ in range(8):
        value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
    return value


_CRC32C = [_crc_of_byte(value) for value in range(256)]


def _pcd(folder: Path) -> None:
    for encoding in ("ascii", "binary", "binary_compressed"):
        (folder / f"{encoding}.pcd").write_bytes(pcd(xyz().astype("<f4"), encoding))


def _ply(folder: Path) -> None:
    for encoding in ("ascii", "binary_little_endian"):
        (folder / f"{encoding}.ply").write_bytes(ply(xyz().astype("<f4"), encoding))
    for encoding in ("ascii", "binary"):
        (folder / f"{encoding} mesh.ply").write_bytes(_box().export(file_type="ply", encoding=encoding))


def _mesh(ending: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        exported = _box().export(file_type=ending)
        (folder / f"box.{ending}").write_bytes(exported if isinstance(exported, bytes) else exported.encode())

    return make


def _box() -> object:
    import trimesh

    return trimesh.creation.box((4, 3, 2)).subdivide()


def _npy(folder: Path) -> None:
    np.save(folder / "rows.npy", xyz())
    records = np.zeros(_POINTS, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "u1")])
    np.save(folder / "records.npy", records)


def _text(folder: Path) -> None:
    rows = "".join("{:.3f} {:.3f} {:.3f}\n".format(*row) for row in xyz())
    (folder / "plain.xyz").write_text(rows)
    (folder / "counted.pts").write_text(f"{_POINTS}\n{rows}")
    (folder / "named.csv").write_text("x,y,z\n" + rows.replace(" ", ","))
    (folder / "scan.3d").write_text(rows)
    (folder / "two.pts").write_text(f"{_POINTS}\n{rows}" * 2)
    eye = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    (folder / "two.ptx").write_text(f"10\n{_POINTS // 10}\n{eye}{rows}" * 2)


def _octomap(folder: Path) -> None:
    """A chain of 16 nodes to two voxels, as OctoMap writes it."""
    head = "# Octomap OcTree{} file\nid OcTree\nsize 18\nres 0.1\ndata\n"
    chain = b"\x03\x00" * 15 + b"\x0a\x00"
    (folder / "binary.bt").write_bytes(head.format(" binary").encode() + chain)
    full = b"\0\0\x80\x3f\x01" * 15 + b"\0\0\x80\x3f\x03" + b"\0\0\x80\x3f\x00" * 2
    (folder / "full.ot").write_bytes(head.format("").encode() + full)


def _bin(folder: Path) -> None:
    (folder / "kitti.bin").write_bytes(np.c_[xyz(), np.ones(_POINTS)].astype("<f4").tobytes())


def _bag(kind: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        stores = stores_of(kind)
        messages = [("/points", 10**9 * n, cloud_of_points(xyz(n)[:20], stores=stores)) for n in range(4)]
        path = write_bag(folder, kind, messages)
        if path.is_dir():  # the file alone, as robots leave it
            (file,) = (one for one in path.iterdir() if one.name != "metadata.yaml")
            file.rename(folder / f"bag{''.join(file.suffixes)}")
            (path / "metadata.yaml").unlink()
            path.rmdir()

    return make


def _read_bag(path: Path) -> None:
    with open_recording(path) as bag:
        for _ in bag.messages([bag.cloud_topic(None).name]):
            pass


def _zip(folder: Path) -> None:
    body = pcd(xyz().astype("<f4"), "ascii")
    for name, packing in (("stored", zipfile.ZIP_STORED), ("deflated", zipfile.ZIP_DEFLATED)):
        with zipfile.ZipFile(folder / f"{name}.zip", "w", packing) as made:
            for number in range(3):
                made.writestr(f"hall/{number}.pcd", body)


def _unzip(path: Path) -> None:
    with TemporaryDirectory() as folder:
        unpack(path, Path(folder) / "unpacked")


def _glim(folder: Path) -> None:
    for number in range(2):
        submap = folder / "dump" / f"{number:06d}"
        submap.mkdir(parents=True)
        rows = "\n".join(" ".join(map(str, row)) for row in np.eye(4).tolist())
        (submap / "data.txt").write_text(f"id: {number}\nT_world_origin: \n{rows}\n")
        (submap / "points_compact.bin").write_bytes(xyz(number).astype("<f4").tobytes())
    (folder / "dump" / "traj_lidar.txt").write_text("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n")


def _folders(folder: Path) -> None:
    """As mapping programs leave them."""
    points = xyz()
    poses = [from_quaternion([1.0 + n, 2.0, 1.5], [0.0, 0.0, 0.1 * n, 1.0]) for n in range(4)]
    halves = np.array_split(points, 2)
    program_folders.write_divided_map(folder / "autoware", points)
    program_folders.write_intervals(folder / "fast-lio", halves)
    program_folders.write_kiss_slam(folder / "kiss-slam", halves, poses, points)
    program_folders.write_rtabmap(folder / "rtabmap", points, poses)
    program_folders.write_hdmapping(folder / "hdmapping", halves, [poses[:2], poses[2:]])
    program_folders.write_sc_lio_sam(folder / "sc-lio-sam", [points] * 4, poses)
    program_folders.write_hdl_graph_slam(folder / "hdl", [points] * 4, poses)


def _trajectory(folder: Path) -> None:
    (folder / "graph.g2o").write_text("".join(f"VERTEX_SE3:QUAT {n} {n} 2 3 0 0 0 1\n" for n in range(20)))
    (folder / "w_first.txt").write_text("# t x y z qw qx qy qz\n" + "0 1 2 3 1 0 0 0\n" * 20)
    (folder / "tum.txt").write_text("".join(f"{n} {n} 2 3 0 0 0 1\n" for n in range(20)))
    (folder / "named.csv").write_text("tx,ty,tz,qx,qy,qz,qw\n" + "1,2,3,0,0,0,1\n" * 20)


def _read_trajectory(path: Path) -> None:
    from firstfix_builder.sources.read_map import read_trajectory

    read_trajectory(path)


def _bodies(names: tuple[str, ...]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for body in good_bodies(points=_POINTS):
            if body.name in names:
                (folder / f"{body.name}.body").write_bytes(
                    json.dumps(body.media_type).encode() + b"\n" + body.data
                )

    return make


def _read_body(path: Path) -> None:
    """The first line is the media type; a wound there leaves a type that no decoder has."""
    head, _, body = path.read_bytes().partition(b"\n")
    decode_query(body, head.decode("latin-1").strip('"'))


FORMATS: dict[str, Format] = {
    "las": Format(_las, read_map),
    "las scan": Format(_las, _read_las_scan),
    "laz": Format(_laz, read_map),
    "copc": Format(_copc, read_map),
    "e57": Format(_e57, read_map, repair=e57_checksums),
    "pcd": Format(_pcd, read_map),
    "ply": Format(_ply, read_map),
    "obj": Format(_mesh("obj"), read_map),
    "stl": Format(_mesh("stl"), read_map),
    "glb": Format(_mesh("glb"), read_map),
    "npy": Format(_npy, read_map),
    "text": Format(_text, read_map),
    "octomap": Format(_octomap, read_map),
    "bin": Format(_bin, read_map),
    "db3": Format(_bag("sqlite3"), _read_bag),
    "db3 zstd": Format(_bag("sqlite3 zstd message"), _read_bag),
    "mcap": Format(_bag("mcap"), _read_bag),
    "mcap zstd": Format(_bag("mcap zstd chunk"), _read_bag),
    "ros1": Format(_bag("ros1"), _read_bag),
    "zip": Format(_zip, _unzip),
    "folders": Format(_folders, read_map, wounded="folders"),
    "glim": Format(_glim, read_map, wounded="dump"),
    "trajectory": Format(_trajectory, _read_trajectory),
    "wire": Format(_bodies(("scan", "range image", "scans")), _read_body),
    "compact": Format(_bodies(("query",)), _read_body),
}
