"""Headers of resumable uploads: tus 1.0 with creation, checksum, termination and expiration."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
from datetime import timedelta
from email.utils import format_datetime

from firstfix.catalog.uploads.uploads import Upload
from firstfix.errors import ChecksumMismatch, InvalidOption, PreconditionFailed
from firstfix.maintenance.garbage import DAY_S

VERSION = "1.0.0"
EXTENSIONS = "creation,checksum,termination,expiration"
MEDIA_TYPE = "application/offset+octet-stream"
CHECKSUMS = ("sha256", "sha1")
_NUMBER = re.compile(r"[0-9]{1,18}")


def check_version(given: str | None) -> None:
    """Check the caller's tus version. None is accepted, because clients like curl do not send it.

    Raises:
        PreconditionFailed: another version.
    """
    if given not in (None, VERSION):
        raise PreconditionFailed(f"this service speaks tus {VERSION}")


def number(name: str, text: str) -> int:
    """The number in a header.

    Args:
        name: of the header.

    Raises:
        InvalidOption: it is not a number.
    """
    if not _NUMBER.fullmatch(text):
        raise InvalidOption(f"{name} is a number of bytes, not {text[:40]!r}")
    return int(text)


def metadata(text: str) -> dict[str, str]:
    """The names and decoded values of an Upload-Metadata header.

    Raises:
        InvalidOption: the header is malformed.
    """
    found: dict[str, str] = {}
    for pair in filter(None, (pair.strip() for pair in text.split(","))):
        name, _, value = pair.partition(" ")
        if name in found:
            raise InvalidOption(f"Upload-Metadata has {name[:40]!r} twice")
        try:
            found[name] = base64.b64decode(value.strip(), validate=True).decode()
        except (binascii.Error, ValueError):
            raise InvalidOption(f"Upload-Metadata: {name[:40]!r} is not base64 of UTF-8") from None
    return found


class Checksum:
    """The checksum in an Upload-Checksum header.

    Raises:
        InvalidOption: unknown algorithm, or the digest is malformed.
    """

    def __init__(self, header: str) -> None:
        name, _, value = header.partition(" ")
        if name not in CHECKSUMS:
            raise InvalidOption(f"Upload-Checksum is one of {', '.join(CHECKSUMS)}, not {name[:40]!r}")
        self._name = name
        try:
            self._expected = base64.b64decode(value.strip(), validate=True)
        except (binascii.Error, ValueError):
            raise InvalidOption("Upload-Checksum: not base64") from None
        if len(self._expected) != hashlib.new(name, usedforsecurity=False).digest_size:
            raise InvalidOption(f"Upload-Checksum: not a {name} digest")

    def check(self, data: bytes) -> None:
        """Check the digest of a body.

        Raises:
            ChecksumMismatch: the data have another digest.
        """
        if hashlib.new(self._name, data, usedforsecurity=False).digest() != self._expected:
            raise ChecksumMismatch(f"the {self._name} of the part differs from its Upload-Checksum")


def headers_of(upload: Upload) -> dict[str, str]:
    """The headers with the upload's offset, length and expiry."""
    until = upload.last_modified + timedelta(seconds=DAY_S)
    return {
        "Tus-Resumable": VERSION,
        "Upload-Offset": str(upload.offset),
        "Upload-Length": str(upload.size_bytes),
        "Upload-Expires": format_datetime(until, usegmt=True),
        "Cache-Control": "no-store",
    }
