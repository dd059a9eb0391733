"""Reading a binary body piece by piece: headers, runs of bytes, and zstd frames of a bounded size."""

from __future__ import annotations

import struct
from typing import Any

import zstandard

from ..errors import MalformedData

_MAX_WINDOW_BYTES = 1 << 20


class FrameReader:
    """The bytes of one body that are not read yet.

    Args:
        name: of the format, for errors.

    Every method raises MalformedData where the bytes end too early or contradict themselves.
    """

    def __init__(self, body: bytes | memoryview, name: str) -> None:
        self._rest, self._name = memoryview(body), name

    @property
    def left(self) -> int:
        """How many bytes are not read yet."""
        return len(self._rest)

    def take(self, count: int) -> memoryview:
        if len(self._rest) < count:
            raise MalformedData(f"the {self._name} is cut off: {len(self._rest)} bytes where {count} belong")
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken

    def header(self, form: struct.Struct) -> tuple[Any, ...]:
        return form.unpack(self.take(form.size))

    def frame(self, length: int, least: int, most: int) -> bytes:
        """The content of a zstd frame, whose declared size must lie in a range."""
        frame = self.take(length)
        try:
            declared = zstandard.get_frame_parameters(frame).content_size
            if not least <= declared <= most:
                raise MalformedData(f"a zstd frame declares {declared} bytes, not {least} to {most}")
            content = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES).decompress(
                frame, max_output_size=most, allow_extra_data=False
            )
        except zstandard.ZstdError as error:
            raise MalformedData(f"a zstd frame of the {self._name} is damaged: {error}") from None
        if len(content) != declared:
            raise MalformedData(f"a zstd frame holds {len(content)} bytes and declares {declared}")
        return content

    def check(self, fields: dict[str, bool]) -> None:
        """Of a header: by a field's name whether it is as it may be."""
        for field, sound in fields.items():
            if not sound:
                raise MalformedData(f"the {field} of the {self._name} header is out of range")

    def end(self) -> None:
        if self._rest:
            raise MalformedData(f"{len(self._rest)} bytes follow the {self._name}")
