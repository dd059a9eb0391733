"""Writers of point-cloud formats for tests, written from the specifications."""

from __future__ import annotations

import struct

import lzf
import numpy as np

KIND = {"f": "F", "i": "I", "u": "U"}
PLY_TYPE = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int", "u2": "ushort", "u4": "uint"}


def random_cloud(n: int = 50, dtype: str = "f4", seed: int = 1) -> np.ndarray:
    """(n,) records x y z intensity ring."""
    rng = np.random.default_rng(seed)
    fields = [*((axis, f"<{dtype}") for axis in "xyz"), ("intensity", "<f4"), ("ring", "<u2")]
    cloud = np.zeros(n, fields)
    for axis in "xyz":
        cloud[axis] = rng.uniform(-50, 50, n)
    cloud["intensity"], cloud["ring"] = rng.uniform(0, 255, n), rng.integers(0, 64, n)
    return cloud


def pcd_header(cloud: np.ndarray, encoding: str, **replaced: object) -> bytes:
    names = cloud.dtype.names
    entries = {
        "VERSION": "0.7",
        "FIELDS": " ".join(names),
        "SIZE": " ".join(str(cloud.dtype[name].itemsize) for name in names),
        "TYPE": " ".join(KIND.get(cloud.dtype[name].kind, "U") for name in names),
        "COUNT": " ".join("1" for _ in names),
        "WIDTH": len(cloud),
        "HEIGHT": 1,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": len(cloud),
        "DATA": encoding,
        **replaced,
    }
    lines = [f"{key} {value}" for key, value in entries.items() if value is not None]
    return ("# .PCD v0.7 - Point Cloud Data file format\n" + "\n".join(lines) + "\n").encode()


def text_rows(cloud: np.ndarray, separator: str = " ") -> bytes:
    return "".join(separator.join(repr(v.item()) for v in row) + "\n" for row in cloud).encode()


def pcd_body(cloud: np.ndarray, encoding: str) -> bytes:
    if encoding == "ascii":
        return text_rows(cloud)
    if encoding == "binary":
        return cloud.tobytes()
    plain = b"".join(np.ascontiguousarray(cloud[name]).tobytes() for name in cloud.dtype.names)
    packed = lzf.compress(plain, 2 * len(plain)) if plain else b""
    return struct.pack("<II", len(packed), len(plain)) + packed


def pcd(cloud: np.ndarray, encoding: str, **replaced: object) -> bytes:
    return pcd_header(cloud, encoding, **replaced) + pcd_body(cloud, encoding)


def ply(cloud: np.ndarray, encoding: str, before: bytes = b"", before_body: bytes = b"") -> bytes:
    order = ">" if encoding == "binary_big_endian" else "<"
    header = f"ply\nformat {encoding} 1.0\ncomment by a test\n".encode() + before
    header += f"element vertex {len(cloud)}\n".encode()
    for name in cloud.dtype.names:
        header += f"property {PLY_TYPE[cloud.dtype[name].str[1:]]} {name}\n".encode()
    header += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if encoding == "ascii":
        return header + before_body + text_rows(cloud) + b"3 0 1 2\n"
    face = struct.pack(order + "B3i", 3, 0, 1, 2)
    return header + before_body + cloud.astype(cloud.dtype.newbyteorder(order)).tobytes() + face
