"""Submissions of POST /maps: read and checked completely before anything is stored or built."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import Request

from firstfix.access.permissions import Scope
from firstfix.builds.config import BuildConfig
from firstfix.builds.source_policy import check_source_url
from firstfix.catalog.provenance import check_note
from firstfix.catalog.sources import put_source, source_key
from firstfix.errors import InvalidOption
from firstfix.ids import check_map_id, check_upload_id
from firstfix.maintenance.pending_deletions import is_deletion_pending
from firstfix.store.sha256 import sha256_of

from ...auth.principal import Principal
from ..parts import UploadParts
from .form import FormDirectory, FormFile, harmless_name, receive_form
from .json_body import parse_object, read_object
from .uploads import own_upload

_TEXTS, _FILES = {"map_id", "config", "note"}, {"source", "trajectory"}


@dataclass(frozen=True)
class NamedUrl:
    """A file at a URL. The build worker fetches it."""

    url: str

    @property
    def file_name(self) -> str:
        """The last part of the URL's path."""
        return harmless_name(self.url.split("?", 1)[0])


@dataclass(frozen=True)
class NamedUpload:
    """A file that was sent to /uploads."""

    upload_id: str


Source = FormFile | NamedUrl | NamedUpload


@dataclass(frozen=True)
class Submission:
    """A map to be built.

    Attributes:
        config: of the build, as given; it was checked.
        note: of the caller, for people.
    """

    caller: Principal
    map_id: str
    source: Source
    trajectory: Source | None
    config: Mapping[str, Any]
    note: str = ""

    @property
    def copies_uploads(self) -> bool:
        """True if the store must copy uploads, which can take as long as sending them."""
        return any(isinstance(source, NamedUpload) for source in (self.source, self.trajectory))

    def fingerprint(self) -> str:
        """A digest that is equal for equal submissions. Of a form's files, the content counts."""
        described = [self.map_id, _identity(self.source), _identity(self.trajectory), self.config]
        described += [self.note] if self.note else []
        return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()

    def keep(self, parts: UploadParts, *, build_id: str = "") -> dict[str, Any]:
        """Put the files into the store and return the build's record.

        It may be repeated, and then restores files that a garbage collection has removed meanwhile.

        Args:
            build_id: not empty: the files are stored once more, for this build alone.

        Raises:
            NotFound: no such upload of this caller.
            OutOfSpace: the store has no room for another copy of an upload.
            Conflict: an upload is not complete.
            StoreError: the store failed.
        """
        source, file_name = self._kept(parts, self.source, build_id)
        trajectory = None
        if self.trajectory is not None:
            named, name = self._kept(parts, self.trajectory, build_id)
            trajectory = {**named, "file_name": name}
        return {
            "map_id": self.map_id,
            "source": source,
            "file_name": file_name,
            "trajectory": trajectory,
            "config": self.config,
            "owner": self.caller.name,
            **({"note": self.note} if self.note else {}),
        }

    def _kept(self, parts: UploadParts, source: Source, build_id: str) -> tuple[dict[str, str], str]:
        """The source's entry in the record, and the file name whose suffix says how to read it."""
        if isinstance(source, NamedUrl):
            return {"url": source.url}, source.file_name
        if isinstance(source, FormFile):
            sha256 = put_source(parts.store, self.map_id, source.path, build_id=build_id)
            return {"key": source_key(self.map_id, sha256)}, source.file_name
        upload = own_upload(parts.uploads, self.caller, source.upload_id)
        with parts.disks.reserve("the store's disk", parts.store.directory) as room:
            room.ensure(upload.size_bytes)
            sha256 = parts.uploads.keep_as_source(upload, self.map_id, build_id=build_id)
        return {"key": source_key(self.map_id, sha256)}, upload.file_name


def keep_for_good(
    parts: UploadParts, build_id: str, record: Mapping[str, Any], submission: Submission
) -> None:
    """Make sure that a recorded build has its files.

    A garbage collection that began before the record was written may have removed a file, or may still do so.
    Then the build gets a copy of its own.

    Raises:
        FirstfixError: as ``Submission.keep``.
    """
    store = parts.store
    keys = [one["key"] for role in ("source", "trajectory") if (one := record.get(role)) and "key" in one]
    if any(is_deletion_pending(store, key) for key in keys):
        submission.keep(parts, build_id=build_id)
    elif not all(map(store.exists, keys)):
        submission.keep(parts)


async def from_form(
    request: Request, parts: UploadParts, caller: Principal, directory: FormDirectory
) -> Submission:
    """The submission in a multipart form. Its files are in the directory.

    Raises:
        InvalidOption, MalformedData, TooLarge: the form cannot be used.
        OutOfSpace: there is no room for it here or in the store.
        DeadlineExceeded: it arrives too slowly.
        Forbidden: the caller may not build this map.
    """
    form = await receive_form(request, parts, directory, _TEXTS, _FILES)
    if "source" not in form.files:
        raise InvalidOption("the form has no file 'source'")
    return Submission(
        caller,
        _map_id(caller, form.texts.get("map_id", "")),
        form.files["source"],
        form.files.get("trajectory"),
        _checked_config(parse_object((form.texts.get("config") or "{}").encode(), "config")),
        check_note(form.texts.get("note", "")),
    )


async def from_json(request: Request, parts: UploadParts, caller: Principal) -> Submission:
    """The submission in a JSON body, which names URLs or uploads.

    Raises:
        InvalidOption, MalformedData, TooLarge: the body cannot be used, or the operator forbids a URL.
        Forbidden: the caller may not build this map.
    """
    body = await read_object(request)
    unknown = set(body) - {"map_id", "source", "trajectory", "config", "note"}
    if unknown:
        raise InvalidOption(f"no field {', '.join(sorted(unknown))[:200]}")
    config = body.get("config") or {}
    if not isinstance(config, dict):
        raise InvalidOption("config is not a JSON object")
    trajectory = body.get("trajectory")
    return Submission(
        caller,
        _map_id(caller, str(body.get("map_id", ""))),
        _named(parts, body.get("source"), "source"),
        None if trajectory is None else _named(parts, trajectory, "trajectory"),
        _checked_config(config),
        check_note(body.get("note") or ""),
    )


def _map_id(caller: Principal, given: str) -> str:
    map_id = check_map_id(given)
    caller.check(Scope.BUILD, map_id)
    return map_id


def _checked_config(config: dict[str, Any]) -> dict[str, Any]:
    BuildConfig.parse(config)
    return config


def _named(parts: UploadParts, named: Any, role: str) -> NamedUrl | NamedUpload:
    if isinstance(named, dict) and len(named) == 1:
        ((kind, value),) = named.items()
        if kind == "url" and isinstance(value, str):
            return NamedUrl(check_source_url(value, parts.source_urls))
        if kind == "upload" and isinstance(value, str):
            return NamedUpload(check_upload_id(value))
    raise InvalidOption(f'{role} is {{"url": "..."}} or {{"upload": "..."}}')


def _identity(source: Source | None) -> list[str] | None:
    if source is None:
        return None
    if isinstance(source, FormFile):
        return ["file", source.file_name, sha256_of(source.path)]
    if isinstance(source, NamedUrl):
        return ["url", source.url]
    return ["upload", source.upload_id]
