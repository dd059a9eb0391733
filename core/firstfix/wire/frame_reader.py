"""Reader of a binary body: headers, bytes, and zstd frames of a bounded size."""

from __future__ import annotations

import struct
import threading
from typing import Any

import zstandard

from ..errors import MalformedData

_MAX_WINDOW_BYTES = 1 << 20


class _OfThread(threading.local):
    """A decompressor for each thread: making one takes longer than the frames of a compact scan."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW_BYTES)


_of_thread = _OfThread()


class FrameReader:
    """Reads one body from its beginning.

    Every method raises MalformedData if the body ends too early or contradicts itself.

    Args:
        name: name of the format, for error messages.
    """

    def __init__(self, body: bytes | memoryview, name: str) -> None:
        self._rest, self._name = memoryview(body), name

    @property
    def left(self) -> int:
        """Number of bytes that are not read yet."""
        return len(self._rest)

    def take(self, count: int) -> memoryview:
        """The next bytes."""
        if len(self._rest) < count:
            raise MalformedData(f"the {self._name} is cut off: {len(self._rest)} of {count} bytes")
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken

    def header(self, form: struct.Struct) -> tuple[Any, ...]:
        """The fields of a header."""
        return form.unpack(self.take(form.size))

    def frame(self, length: int, least: int, most: int) -> bytes:
        """The content of a zstd frame. Its declared size must be in [least, most]."""
        frame = self.take(length)
        try:
            declared = zstandard.get_frame_parameters(frame).content_size
            if not least <= declared <= most:
                raise MalformedData(f"a zstd frame declares {declared} bytes, not {least} to {most}")
            content = _of_thread.decompressor.decompress(frame, max_output_size=most, allow_extra_data=False)
        except zstandard.ZstdError as error:
            raise MalformedData(f"a zstd frame of the {self._name} is damaged: {error}") from None
        if len(content) != declared:
            raise MalformedData(f"a zstd frame has {len(content)} bytes but declares {declared}")
        return content

    def check(self, fields: dict[str, bool]) -> None:
        """Check fields of a header.

        Args:
            fields: name of each field, and whether its value is allowed.
        """
        for field, allowed in fields.items():
            if not allowed:
                raise MalformedData(f"the {field} of the {self._name} header is out of range")

    def end(self) -> None:
        """Check that no bytes are left."""
        if self._rest:
            raise MalformedData(f"{len(self._rest)} bytes follow the {self._name}")
