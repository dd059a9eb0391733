"""What a file really is, by its first bytes: a picture named .pcd is said to be one."""

from __future__ import annotations

from pathlib import Path

from firstfix.errors import MalformedData

# How files of these endings begin. Text has no such beginning.
_BEGINS = {
    ".las": (b"LASF",),
    ".laz": (b"LASF",),
    ".e57": (b"ASTM-E57",),
    ".ply": (b"ply",),
    ".glb": (b"glTF",),
    ".npy": (b"\x93NUMPY",),
}
_PCD_WORDS = (
    "VERSION",
    "FIELDS",
    "COLUMNS",
    "SIZE",
    "TYPE",
    "COUNT",
    "WIDTH",
    "HEIGHT",
    "VIEWPOINT",
    "POINTS",
    "DATA",
)
_KINDS = (
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x1f\x8b", "a gzip archive: unpack it first"),
    (b"BZh", "a bzip2 archive: unpack it first"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive: unpack it first"),
    (b"\xfd7zXZ", "an xz archive: unpack it first"),
    (b"\x89HDF", "an HDF5 file"),
    (b"SQLite format 3", "an SQLite database, such as a ROS 2 bag"),
    (b"#ROSBAG", "a ROS 1 bag"),
    (b"\x89MCAP", "an MCAP recording"),
    (b"version https://git-lfs", "a pointer of Git LFS: run git lfs pull"),
    (b"<!DOCTYPE", "a web page: was a login page saved instead of the file?"),
    (b"<html", "a web page: was a login page saved instead of the file?"),
    (b"LASF", "a LAS or LAZ file: name it .las or .laz"),
    (b"ASTM-E57", "an E57 file: name it .e57"),
    (b"ply\n", "a PLY file: name it .ply"),
    (b"ply\r", "a PLY file: name it .ply"),
    (b"# .PCD", "a PCD file: name it .pcd"),
    (b"\x93NUMPY", "a NumPy array: name it .npy"),
    (b"glTF", "a GLB file: name it .glb"),
)
_READ_BYTES = 4096


def check_kind(path: Path) -> None:
    """Checks that a file begins as files of its ending do.

    Raises:
        MalformedData: it is of another kind, which the message names.
    """
    with path.open("rb") as file:
        head = file.read(_READ_BYTES)
    ending = path.suffix.lower()
    if ending == ".pcd" and _is_pcd(head):
        return
    if ending in _BEGINS and head.startswith(_BEGINS[ending]):
        return
    kind = next((name for begin, name in _KINDS if head.startswith(begin)), None)
    if kind is not None:
        raise MalformedData(f"this is no {ending[1:].upper()} file but {kind}")
    if ending == ".pcd" or ending in _BEGINS:
        what = "text" if _is_text(head) else "no file of a kind that is known here"
        raise MalformedData(
            f"this is no {ending[1:].upper()} file, it is {what}: it does not begin as such a file does"
        )


def _is_pcd(head: bytes) -> bool:
    """Returns whether the first line that is no comment begins with a word of a PCD header."""
    for line in head.split(b"\n"):
        words = line.split()
        if words and not words[0].startswith(b"#"):
            return words[0].decode("latin-1").upper() in _PCD_WORDS
    return False


def _is_text(head: bytes) -> bool:
    return b"\0" not in head and sum(byte < 9 or 13 < byte < 32 for byte in head) == 0
