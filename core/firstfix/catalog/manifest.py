"""The manifest of a map version: what it is made of, and so its name.

A version is named by the sha256 of its manifest's canonical JSON. The manifest covers content and
config only: no time, no host, no path, so that the same map and config give the same version
wherever and however often they are built.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ..errors import CorruptVersion, IncompatibleVersion, InvalidOption
from ..store.object_keys import check_key
from ..store.sha256 import sha256_of

FORMAT = 6  # this release reads no other
FILE_NAME = "manifest.json"
MAX_BYTES = 64 << 20
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class FileEntry:
    """One file of a version."""

    bytes: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """What a version is made of.

    Values may be given with numpy numbers, arrays and tuples inside: they are kept as plain JSON.

    Attributes:
        files: name relative to the version's folder, ``/`` between segments.
        engine: config of the search, read back by whoever loads the version.
        config: the build's config.
        sensor: the sensor model of the templates.
        origin: (3,) metres, added to local coordinates gives those of the source file.
        source: ``sha256`` of what it was built from.
        counts: for people: templates, map points.
        self_test: what the builder measured, calibration and localizability included.
        bounds: ((3,), (3,)) lowest and highest local coordinates, metres.
        format: of the files and of this record.
    """

    files: Mapping[str, FileEntry]
    engine: Mapping[str, Any] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)
    sensor: Mapping[str, Any] = field(default_factory=dict)
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    source: Mapping[str, Any] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    self_test: Mapping[str, Any] = field(default_factory=dict)
    bounds: tuple[tuple[float, ...], ...] = ()
    format: int = FORMAT

    def __post_init__(self) -> None:
        """
        Raises:
            InvalidOption: a file's name is no object key, or a value is no JSON (NaN among them).
        """
        for name in self.files:
            check_key(name)
            if name == FILE_NAME:
                raise InvalidOption("a manifest does not list itself")
        for name in ("engine", "config", "sensor", "source", "counts", "self_test"):
            object.__setattr__(self, name, json.loads(_canonical(getattr(self, name))))
        object.__setattr__(self, "origin", tuple(float(v) for v in self.origin))
        object.__setattr__(self, "bounds", tuple(tuple(float(v) for v in corner) for corner in self.bounds))

    @classmethod
    def for_directory(cls, directory: Path, **values: Any) -> Manifest:
        """The manifest of every file below a directory; ``values`` are the other fields.

        Raises:
            InvalidOption: as the constructor.
        """
        entries = {
            path.relative_to(directory).as_posix(): FileEntry(path.stat().st_size, sha256_of(path))
            for path in sorted(directory.rglob("*"))
            if path.is_file() and path.relative_to(directory).as_posix() != FILE_NAME
        }
        return cls(files=entries, **values)

    @property
    def digest(self) -> str:
        """The version's name: 64 hex characters."""
        return hashlib.sha256(self.to_json()).hexdigest()

    @property
    def total_bytes(self) -> int:
        return sum(entry.bytes for entry in self.files.values())

    def to_mapping(self) -> dict[str, Any]:
        files = {name: {"bytes": entry.bytes, "sha256": entry.sha256} for name, entry in self.files.items()}
        return {**{f.name: getattr(self, f.name) for f in fields(self)}, "files": files}

    def to_json(self) -> bytes:
        """Canonical: sorted keys, no spaces, ASCII, floats as their shortest repr."""
        return _canonical(self.to_mapping())

    @classmethod
    def from_json(cls, data: bytes) -> Manifest:
        """What ``to_json`` gave.

        Raises:
            IncompatibleVersion: another format, or fields that this reader does not know.
            CorruptVersion: not a manifest, or not in canonical form.
        """
        if len(data) > MAX_BYTES:
            raise CorruptVersion(f"a manifest of {len(data)} bytes")
        try:
            mapping = json.loads(data)
            found = mapping["format"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise CorruptVersion("the manifest is no JSON object with a format") from None
        if found != FORMAT or type(found) is not int:
            raise IncompatibleVersion(
                f"the version has format {found!r}, this release reads format {FORMAT}: build the map again with "
                "`firstfix maps rebuild MAP`, or hand it in again (POST /maps)"
            )
        unknown = set(mapping) - {f.name for f in fields(cls)}
        if unknown:
            raise IncompatibleVersion(f"the manifest has unknown fields: {', '.join(sorted(unknown))}")
        try:
            entries = {name: _entry(item) for name, item in mapping.pop("files").items()}
            manifest = cls(files=entries, **mapping)
        except (KeyError, TypeError, ValueError, AttributeError, InvalidOption) as error:
            raise CorruptVersion(f"the manifest is malformed: {error}") from None
        if manifest.to_json() != data:
            raise CorruptVersion("the manifest is not in canonical form")
        return manifest

    def verify_directory(self, directory: Path) -> None:
        """Reads every file of the version and compares size and sha256. Others are not looked at.

        Raises:
            CorruptVersion: names the file that is missing or differs.
        """
        for name, entry in self.files.items():
            verify_file(directory / name, name, entry)


def verify_file(path: Path, name: str, entry: FileEntry) -> None:
    """
    Raises:
        CorruptVersion: the file is missing, or its size or sha256 is not the entry's.
    """
    try:
        size = path.stat().st_size
        if size != entry.bytes:
            raise CorruptVersion(f"{name} has {size} bytes, the manifest says {entry.bytes}")
        if sha256_of(path) != entry.sha256:
            raise CorruptVersion(f"{name} has another sha256 than the manifest says")
    except OSError as error:
        raise CorruptVersion(f"{name} cannot be read: {error.strerror}") from None


def _entry(item: Mapping[str, Any]) -> FileEntry:
    entry = FileEntry(**item)
    if type(entry.bytes) is not int or entry.bytes < 0 or not _SHA256.fullmatch(entry.sha256):
        raise ValueError(f"no size and sha256: {item}")
    return entry


def _canonical(value: Any) -> bytes:
    try:
        text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise InvalidOption(f"no JSON: {error}") from None
    return text.encode("ascii")


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # a numpy number or array
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a {type(value).__name__} has no JSON form")
