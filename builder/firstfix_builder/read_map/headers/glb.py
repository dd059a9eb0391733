"""Counts in a GLB file. trimesh takes memory for every accessor, whether there are bytes for it or not."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import MAP_LIMITS

_HEAD = struct.Struct("<4sIIII")  # magic, version, length; length and kind of the first chunk
_JSON = 0x4E4F534A
_NUMBER_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MOST_RATIO = 200  # of Draco: its accessors have no bytes of their own


def check_glb(path: Path) -> None:
    """Checks the sizes that a file declares.

    Raises:
        MalformedData: it is no GLB, or larger inside than its bytes allow.
        TooLarge: over the limits of maps.
        UnsupportedFormat: a part of it lies in another file.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise MalformedData(f"GLB: the file is cut off: {len(head)} bytes of a header")
        magic, _, length, json_bytes, kind = _HEAD.unpack(head)
        if magic != b"glTF" or kind != _JSON:
            raise MalformedData("GLB: the file does not start with glTF and its JSON")
        if length > size or json_bytes > size - _HEAD.size:
            raise MalformedData(f"GLB: the file is cut off: {size} of {length} bytes")
        try:
            scene = json.loads(file.read(json_bytes))
            declared = sum(map(_bytes_of, scene.get("accessors", [])))
            elsewhere = [one for one in scene.get("buffers", []) if not _is_inside(one)]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise MalformedData(f"GLB: its JSON is damaged: {error or type(error).__name__}") from None
    if elsewhere:
        raise UnsupportedFormat("GLB: a part of it lies in another file")
    if declared > MAP_LIMITS.max_decoded_bytes:
        raise TooLarge(f"GLB: {declared} bytes, the limit is {MAP_LIMITS.max_decoded_bytes} bytes")
    if declared > MOST_RATIO * size:
        raise MalformedData(f"GLB: {size} bytes cannot hold the {declared} bytes that it declares")


def _bytes_of(accessor: dict[str, Any]) -> int:
    count = accessor["count"]
    if not isinstance(count, int) or count < 0:
        raise ValueError(f"a count of {str(count)[:40]}")
    return count * _NUMBER_BYTES[accessor["componentType"]] * _NUMBERS[accessor["type"]]


def _is_inside(buffer: dict[str, Any]) -> bool:
    uri = buffer.get("uri")
    return uri is None or str(uri).startswith("data:")
