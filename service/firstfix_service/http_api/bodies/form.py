"""Multipart forms. Their files are written to disk as they arrive, so gigabytes need little memory.

The parser is python-multipart's, which bounds the boundary and the headers of a field. Its ready-made forms
would not do: they keep a text of any length in memory, and write a file before its name can be refused.
"""

from __future__ import annotations

import re
import shutil
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from firstfix.errors import InvalidOption, MalformedData, TooLarge

from ...limits.disk_space import Reservation
from ...thread_pools import COPIES
from ..parts import UploadParts
from .request_body import paced_pieces

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

MAX_TEXT_BYTES = 1 << 20
_BATCH_BYTES = 1 << 20  # written by one call in a thread


@dataclass(frozen=True)
class FormFile:
    """A file of a form, on disk.

    Attributes:
        file_name: the caller's name for it, made harmless. Its suffix says how to read it.
    """

    path: Path
    file_name: str


@dataclass
class Form:
    """Fields of a multipart form, by name."""

    texts: dict[str, str] = field(default_factory=dict)
    files: dict[str, FormFile] = field(default_factory=dict)


@dataclass(frozen=True)
class FormDirectory:
    """Directory of one form. It is removed with its files."""

    path: Path
    here: Reservation
    in_store: Reservation

    def take(self, size_bytes: int) -> None:
        """Announce a write of so many bytes to the directory.

        Raises:
            OutOfSpace: there is no room here or in the store.
        """
        self.here.take(size_bytes)
        self.in_store.ensure(self.here.taken_bytes)


@asynccontextmanager
async def form_directory(parts: UploadParts, declared_bytes: int) -> AsyncIterator[FormDirectory]:
    """Make a directory for one form and reserves space for it, until the block ends.

    Args:
        declared_bytes: size of the form; 0: not declared.

    Raises:
        OutOfSpace: there is no room for the declared size. No directory was made.
    """
    path = parts.folder / uuid.uuid4().hex
    with (
        parts.disks.reserve("this service's disk", parts.folder) as here,
        parts.disks.reserve("the store's disk", parts.store.directory) as in_store,
    ):

        def make() -> None:
            parts.folder.mkdir(parents=True, exist_ok=True)
            here.ensure(declared_bytes)
            in_store.ensure(declared_bytes)
            path.mkdir()

        try:
            await COPIES.run(make)
            yield FormDirectory(path, here, in_store)
        finally:
            await COPIES.run(shutil.rmtree, path, ignore_errors=True)


async def receive_form(
    request: Request,
    parts: UploadParts,
    directory: FormDirectory,
    text_fields: set[str],
    file_fields: set[str],
) -> Form:
    """The form in a request's body.

    Raises:
        OutOfSpace: see ``FormDirectory.take``.
        DeadlineExceeded: the body is too slow.
        TooLarge: over the limit.
        InvalidOption: a field is unknown or given twice.
        MalformedData: not a multipart form, or cut off.
    """
    _, parameters = parse_options_header(request.headers.get("content-type"))
    boundary = parameters.get(b"boundary")
    if not boundary:
        raise MalformedData("the multipart form has no boundary")
    writer = _FormWriter(directory.path, text_fields, file_fields)
    try:
        parser = MultipartParser(boundary, writer.callbacks())

        def write(data: bytes) -> None:
            directory.take(len(data))
            parser.write(data)

        size = 0
        batch = bytearray()
        async for part in paced_pieces(request, parts.pace):
            size += len(part)
            if size > parts.max_bytes:
                raise TooLarge(f"the form has over {parts.max_bytes} bytes")
            batch += part
            if len(batch) >= _BATCH_BYTES:
                await COPIES.run(write, bytes(batch))
                batch.clear()
        await COPIES.run(write, bytes(batch))
    except FormParserError as error:
        raise MalformedData(f"not a multipart form: {error}") from None
    finally:
        writer.close()
    if not writer.ended:
        raise MalformedData("the multipart form is cut off")
    return writer.form


class _FormWriter:
    """Builds a form from the parser's events."""

    def __init__(self, directory: Path, text_fields: set[str], file_fields: set[str]) -> None:
        self.form = Form()
        self.ended = False
        self._directory = directory
        self._text_fields, self._file_fields = text_fields, file_fields
        self._header_name = self._header_value = b""
        self._headers: dict[bytes, bytes] = {}
        self._name = ""
        self._text = bytearray()
        self._file: BinaryIO | None = None

    def callbacks(self) -> MultipartCallbacks:
        """The handlers of the parser's events."""
        return {
            "on_part_begin": self._begin,
            "on_header_field": self._header_field,
            "on_header_value": self._header_data,
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_part_data": self._data,
            "on_part_end": self._part_end,
            "on_end": self._end,
        }

    def close(self) -> None:
        """Close the file that is being written, if any."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _begin(self) -> None:
        self._headers.clear()
        self._header_name = self._header_value = b""
        self._text = bytearray()

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _header_data(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _header_end(self) -> None:
        self._headers[self._header_name.lower()] = self._header_value
        self._header_name = self._header_value = b""

    def _headers_finished(self) -> None:
        _, parameters = parse_options_header(self._headers.get(b"content-disposition"))
        self._name = parameters.get(b"name", b"").decode("utf-8", "replace")
        if self._name in self.form.texts or self._name in self.form.files:
            raise InvalidOption(f"the form has the field {self._name!r} twice")
        if self._name in self._file_fields:
            given = parameters.get(b"filename", b"").decode("utf-8", "replace")
            path = self._directory / self._name
            self._file = path.open("wb")
            self.form.files[self._name] = FormFile(path, harmless_name(given))
        elif self._name not in self._text_fields:
            wanted = ", ".join(sorted(self._text_fields | self._file_fields))
            raise InvalidOption(f"the form has no field {self._name[:80]!r}; there are {wanted}")

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._file is not None:
            self._file.write(memoryview(data)[start:end])
            return
        self._text += data[start:end]
        if len(self._text) > MAX_TEXT_BYTES:
            raise TooLarge(f"{self._name} has over {MAX_TEXT_BYTES} bytes")

    def _part_end(self) -> None:
        if self._file is not None:
            self.close()
            return
        try:
            self.form.texts[self._name] = self._text.decode("utf-8")
        except UnicodeDecodeError:
            raise MalformedData(f"{self._name} is not UTF-8") from None

    def _end(self) -> None:
        self.ended = True


def harmless_name(name: str) -> str:
    """The last part of a path, with letters, digits, ``.``, ``_`` and ``-`` only, no dot in front."""
    last = re.split(r"[/\\]", name)[-1]
    return re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-100:] or "map"
