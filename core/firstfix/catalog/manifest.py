"""Manifest of a version: its files, configs and measurements. Its sha256 names the version.

The digest is that of the manifest's canonical JSON. The manifest covers content and config only, no time,
host or path. So the same map and config give the same version, wherever and however often they are built:
upon the same base, if something of one is kept.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ..errors import REBUILD, CorruptVersion, IncompatibleVersion, InvalidOption
from ..store.object_keys import check_key
from ..store.sha256 import sha256_of

FORMAT = 9
FILE_NAME = "manifest.json"
CLOUD_INDEX, CLOUD_POINTS = "cloud.json", "cloud.bin"  # for viewers: no query reads them
CLOUD_INTENSITY = "cloud_intensity.bin"
VIEWER_FILES = (CLOUD_INDEX, CLOUD_POINTS, CLOUD_INTENSITY)
SURFACE_FILE, MADE_BY_FILE = "surface_cells.npz", "made_by.json"  # for builds of the next version
_NOT_OF_QUERIES = frozenset({*VIEWER_FILES, SURFACE_FILE, MADE_BY_FILE})
MAX_BYTES = 64 << 20
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class FileEntry:
    """One file of a version."""

    bytes: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """Manifest of a version.

    Values may contain numpy numbers, arrays and tuples: they are stored as plain JSON.

    Attributes:
        files: by name relative to the version's folder, with ``/`` between segments.
        engine: config of the search, read by the process that loads the version.
        config: config of the build.
        sensor: sensor model of the templates.
        origin: (3,) metres; local coordinates plus this are coordinates of the source file.
        source: ``sha256`` of the source as it was read, its ``findings``, and ``sessions``: places of its
            sessions, if it has any; ``rebuilt``: what is kept of which version, if anything is.
        counts: numbers of templates and map points, for people.
        self_test: measurements of the builder, with calibration and localizability.
        bounds: ((3,), (3,)) lowest and highest local coordinates, metres.
        provisional: a coarse version that was not tested, until the full one takes its place.
        format: format of the files and of this record.
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
    provisional: bool = False
    format: int = FORMAT

    def __post_init__(self) -> None:
        """Check and normalise the values.

        Raises:
            InvalidOption: a file name is not an object key, or a value is not JSON (NaN is not).
        """
        for name in self.files:
            check_key(name)
            if name == FILE_NAME:
                raise InvalidOption("a manifest must not list itself")
        for name in ("engine", "config", "sensor", "source", "counts", "self_test"):
            object.__setattr__(self, name, json.loads(_canonical(getattr(self, name))))
        object.__setattr__(self, "origin", tuple(float(v) for v in self.origin))
        object.__setattr__(self, "bounds", tuple(tuple(float(v) for v in corner) for corner in self.bounds))

    @classmethod
    def for_directory(cls, directory: Path, **values: Any) -> Manifest:
        """Manifest of all files below a directory. ``values`` are the other fields.

        Raises:
            InvalidOption: a file name or value is invalid.
        """
        entries = {
            path.relative_to(directory).as_posix(): FileEntry(path.stat().st_size, sha256_of(path))
            for path in sorted(directory.rglob("*"))
            if path.is_file() and path.relative_to(directory).as_posix() != FILE_NAME
        }
        return cls(files=entries, **values)

    @property
    def digest(self) -> str:
        """SHA-256 that names the version, 64 hex characters."""
        return hashlib.sha256(self.to_json()).hexdigest()

    @property
    def total_bytes(self) -> int:
        """Size of all files together."""
        return sum(entry.bytes for entry in self.files.values())

    @property
    def query_files(self) -> Mapping[str, FileEntry]:
        """Files that a process which answers queries fetches and verifies: no viewer's, no build's."""
        return {name: entry for name, entry in self.files.items() if name not in _NOT_OF_QUERIES}

    @property
    def query_bytes(self) -> int:
        """Size of ``query_files`` together."""
        return sum(entry.bytes for entry in self.query_files.values())

    def to_mapping(self) -> dict[str, Any]:
        """JSON-ready form."""
        files = {name: {"bytes": entry.bytes, "sha256": entry.sha256} for name, entry in self.files.items()}
        values = {**{f.name: getattr(self, f.name) for f in fields(self)}, "files": files}
        if not self.provisional:
            del values["provisional"]
        return values

    def to_json(self) -> bytes:
        """Canonical JSON: sorted keys, no spaces, ASCII, floats in their shortest form."""
        return _canonical(self.to_mapping())

    @classmethod
    def from_json(cls, data: bytes) -> Manifest:
        """Parse the result of ``to_json``.

        Raises:
            IncompatibleVersion: the manifest has another format, or unknown fields.
            CorruptVersion: the data is not a manifest, or not in canonical form.
        """
        if len(data) > MAX_BYTES:
            raise CorruptVersion(f"the manifest has {len(data)} bytes: a manifest has at most {MAX_BYTES}")
        try:
            mapping = json.loads(data)
            found = mapping["format"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise CorruptVersion("the manifest is not a JSON object with a format") from None
        if found != FORMAT or type(found) is not int:
            raise IncompatibleVersion(
                f"the version has format {found!r}, this release reads {FORMAT}: {REBUILD}"
            )
        unknown = set(mapping) - {f.name for f in fields(cls)}
        if unknown:
            raise IncompatibleVersion(f"the manifest has unknown fields: {', '.join(sorted(unknown))}")
        try:
            entries = {name: _entry(item) for name, item in mapping.pop("files").items()}
            manifest = cls(files=entries, **mapping)
            if type(manifest.provisional) is not bool:
                raise TypeError("provisional is neither true nor false")
        except (KeyError, TypeError, ValueError, AttributeError, InvalidOption) as error:
            raise CorruptVersion(f"a field of the manifest is missing or wrong: {error}") from None
        if manifest.to_json() != data:
            raise CorruptVersion("the manifest is not in canonical form")
        return manifest

    def verify_directory(self, directory: Path) -> None:
        """Read every file of the version and compare size and sha256. Ignores other files.

        Raises:
            CorruptVersion: a file is missing or differs; the message names it.
        """
        for name, entry in self.files.items():
            verify_file(directory / name, name, entry)


def verify_file(path: Path, name: str, entry: FileEntry) -> None:
    """Compare size and sha256 of a file with its entry.

    Raises:
        CorruptVersion: the file is missing or differs.
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
        raise ValueError(f"not a size and a sha256: {item}")
    return entry


def _canonical(value: Any) -> bytes:
    try:
        text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise InvalidOption(f"not JSON: {error}") from None
    return text.encode("ascii")


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # a numpy number or array
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a {type(value).__name__} has no JSON form")
