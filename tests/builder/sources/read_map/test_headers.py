"""Counts in GLB, E57 and PLY files are compared with their size before a library believes them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import Limits
from firstfix_builder.sources.read_map import mesh_file, read_map
from firstfix_builder.sources.read_map.headers import check_points
from tests.hostile_files import FORMATS, e57_checksums


@pytest.fixture
def glb(tmp_path: Path) -> Path:
    FORMATS["glb"].make(tmp_path)
    return tmp_path / "box.glb"


@pytest.fixture
def e57(tmp_path: Path) -> Path:
    FORMATS["e57"].make(tmp_path)
    return tmp_path / "two scans.e57"


def changed(path: Path, change: Any) -> Path:
    """The file with another JSON."""
    raw = path.read_bytes()
    (length,) = struct.unpack_from("<I", raw, 12)
    scene = json.loads(raw[20 : 20 + length])
    change(scene)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + raw[16:20] + text + raw[20 + length :]
    path.write_bytes(raw[:8] + struct.pack("<I", 12 + len(body)) + body)
    return path


FLOATS = {"componentType": 5126, "type": "VEC3"}


@pytest.mark.parametrize(
    ("change", "error", "why"),
    [
        (
            lambda scene: scene["accessors"].append({"count": 10**8, **FLOATS}),
            MalformedData,
            "cannot hold the 12000.* bytes that it declares",
        ),
        (lambda scene: scene["accessors"][0].update(count=10**15), TooLarge, "GLB"),
        (lambda scene: scene["buffers"][0].update(uri="/dev/urandom"), UnsupportedFormat, "another file"),
        (
            lambda scene: scene.update(
                nodes=[{"mesh": 0, "name": f"n{n}"} for n in range(100)],
                scenes=[{"nodes": list(range(100))}],
                scene=0,
            ),
            TooLarge,
            "4800 points, the limit is 1000",
        ),
    ],
    ids=["an accessor without bytes", "a huge accessor", "bytes of another file", "a part placed 100 times"],
)
def test_a_glb_that_declares_more_than_it_has_is_refused(
    glb: Path, change: Any, error: type[Exception], why: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(mesh_file, "MAP_LIMITS", Limits(max_points=1000, max_decoded_bytes=10**9))
    with pytest.raises(error, match=why):
        read_map(changed(glb, change))


@pytest.mark.parametrize(
    "json_text", [b"[" * 100_000, b"{", b"[]", b'{"accessors":[{}]}', b'{"accessors":7}']
)
def test_damaged_json_is_malformed(tmp_path: Path, json_text: bytes):
    (tmp_path / "a.glb").write_bytes(
        struct.pack("<4sIIII", b"glTF", 2, 20 + len(json_text), len(json_text), 0x4E4F534A) + json_text
    )
    with pytest.raises(MalformedData, match=r"a\.glb: GLB"):
        read_map(tmp_path / "a.glb")


def xml_changed(path: Path, old: bytes, new: bytes) -> Path:
    """The file with other bytes of the same length in its XML, and right checksums."""
    assert len(old) == len(new)
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(e57_checksums(raw.replace(old, new)))
    return path


def test_more_points_than_bits_are_malformed(e57: Path):
    check_points(e57, 8 * e57.stat().st_size)
    with pytest.raises(MalformedData, match="bytes for 1000000 points"):
        check_points(e57, 1_000_000)


def test_xml_with_entities_is_malformed(e57: Path):
    with pytest.raises(MalformedData, match="declares a type or entities"):
        read_map(xml_changed(e57, b"<?xml", b"<!ENT"))


@pytest.mark.parametrize(("at", "value"), [(16, 2**40), (24, 2**40), (32, 2**40), (40, 2**32), (40, 0)])
def test_places_beyond_the_end_are_malformed(e57: Path, at: int, value: int):
    raw = bytearray(e57.read_bytes())
    struct.pack_into("<Q", raw, at, value)
    e57.write_bytes(e57_checksums(bytes(raw)))
    with pytest.raises(MalformedData, match="E57"):
        read_map(e57)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
@pytest.mark.parametrize("element", ["vertex", "face"])
def test_more_rows_than_bytes_are_malformed(tmp_path: Path, encoding: str, element: str):
    FORMATS["ply"].make(tmp_path)
    path = tmp_path / f"{encoding} mesh.ply"
    raw = path.read_bytes()
    at = raw.index(f"element {element} ".encode()) + len(f"element {element} ")
    path.write_bytes(raw[:at] + b"1000000" + raw[at:])
    with pytest.raises(MalformedData, match=rf"cut off: .* rows of '{element}'"):
        read_map(path)
