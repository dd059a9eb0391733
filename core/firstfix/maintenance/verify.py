"""Verification of all objects in a store against their names, manifests and kinds, one after another.

    records      can be parsed (``firstfix.maintenance.record_kinds``)
    bodies       of recorded queries and uploads have the sizes and the sha256 in their records
    logs         have no missing number; each published version has a manifest
    versions     the manifest has the digest that names the version, each file the sha256 in the manifest
    sources      have the sha256 in their name

``Verification.steps`` checks a little at a time, so that a service can do it in the background. With a
``Repair`` damaged objects are repaired if possible. Intact objects are never changed.
"""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

from ..catalog.catalog import log_folder
from ..catalog.log.map_log import MapLog
from ..catalog.manifest import MAX_BYTES as MAX_MANIFEST_BYTES
from ..catalog.sources import sha256_of_source
from ..catalog.versions.objects import VersionFolder
from ..errors import NotFound, TooLarge
from ..ids import is_name
from ..store.json_record import max_bytes
from ..store.store import Store, StoredObject
from .bodies import Body, bodies_of_recorded_queries, bodies_of_uploads
from .checked_objects import CheckedObjects
from .record_kinds import FOLDERS, RecordForm, form_of
from .repair import Repair


@dataclass(frozen=True)
class Finding:
    """Damaged object.

    Attributes:
        mended: what was done about it; empty if nothing could be.
    """

    key: str
    problem: str
    mended: str = ""


@dataclass
class VerifyReport:
    """Report of the objects checked so far.

    Attributes:
        objects: number of objects that were read or found missing.
        bytes: number of bytes that were read.
        kinds: number of objects of each kind: of a record its kind, and ``manifest``, ``version_file``,
            ``source``, ``recorded_body`` and ``upload_part``.
        fresh: number of files that were not read, because they were verified lately.
    """

    objects: int = 0
    bytes: int = 0
    fresh: int = 0
    kinds: dict[str, int] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)

    @property
    def damaged(self) -> list[Finding]:
        """Objects that are still damaged."""
        return [finding for finding in self.findings if not finding.mended]


class Verification:
    """One round through a store. Not thread-safe.

    Args:
        repair: repairs damaged objects; None: nothing is written except the notes of ``max_age``.
        max_age: files that were verified within this time, and not put again since, are skipped; verified
            files are noted in the store. None: every file is read, and nothing is noted.
    """

    def __init__(
        self, store: Store, *, repair: Repair | None = None, max_age: timedelta | None = None
    ) -> None:
        self._store = store
        self._repair = repair
        self._max_age = max_age
        self.report = VerifyReport()

    def run(self) -> VerifyReport:
        """Verify the whole store.

        Raises:
            StoreUnavailable, StoreError: the store failed.
        """
        for _ in self.steps():
            pass
        return self.report

    def steps(self) -> Iterator[int]:
        """Verify the store in small steps, each an object or a part of one. Yields the bytes that each read.

        The order of the maps is random. So several rounds that are interrupted, or run at the same time,
        cover different maps.

        Raises:
            StoreUnavailable, StoreError: the store failed.
        """
        for folder in FOLDERS:
            if folder != "maps":
                yield from self._records(self._store.scan(folder))
        for kind, bodies in (
            ("recorded_body", bodies_of_recorded_queries),
            ("upload_part", bodies_of_uploads),
        ):
            for body in bodies(self._store):
                yield from self._body(kind, body)
        map_ids = [name for name in self._store.folders("maps") if is_name(name)]
        for map_id in random.sample(map_ids, len(map_ids)):
            yield from self._map(map_id)

    def _map(self, map_id: str) -> Iterator[int]:
        items = {item.key: item for item in self._store.scan(f"maps/{map_id}")}
        yield from self._records(list(items.values()))
        state = MapLog(self._store, log_folder(map_id)).state()
        for number in state.skipped:
            key = f"{log_folder(map_id)}/{number:06d}.json"
            if key not in items:
                self._found("log_entry", key, "an entry of the log is missing")
        checked = None if self._max_age is None else CheckedObjects(self._store, map_id)
        for version in state.published:
            folder = VersionFolder(map_id, version, state.generation(version))
            yield from self._version(folder, items, checked)
        for key, item in items.items():
            if key.startswith(f"maps/{map_id}/sources/"):
                yield from self._file("source", item, sha256_of_source(key), checked)
        if checked is not None:
            checked.save(set(items))

    def _version(
        self, folder: VersionFolder, items: dict[str, StoredObject], checked: CheckedObjects | None
    ) -> Iterator[int]:
        key = folder.manifest_key
        try:
            data = self._store.get(key, max_bytes=MAX_MANIFEST_BYTES)
        except NotFound:
            state = MapLog(self._store, log_folder(folder.map_id)).state()
            if (
                state.generations.get(folder.version) == folder.generation
            ):  # otherwise it was retired meanwhile
                self._found("manifest", key, "the log has this version as published, but it has no manifest")
            return
        except TooLarge as error:
            self._found("manifest", key, str(error))
            return
        self.report.bytes += len(data)
        yield len(data)
        if hashlib.sha256(data).hexdigest() != folder.version:
            self._found("manifest", key, "the manifest has another digest than the version")
            return
        self._count("manifest", 0)
        files: dict[str, Any] = json.loads(data)["files"]
        for name, entry in files.items():
            item = items.get(f"{folder.key}/{name}")
            if item is not None:
                yield from self._file("version_file", item, entry["sha256"], checked)
            elif not self._store.exists(f"{folder.key}/{name}"):
                self._found(
                    "version_file",
                    f"{folder.key}/{name}",
                    "a file of the version is missing",
                    entry["sha256"],
                )

    def _body(self, kind: str, body: Body) -> Iterator[int]:
        problem = body.problem
        if body.sha256 and not problem:
            digest = hashlib.sha256()
            with suppress(NotFound):  # removed meanwhile
                for key in body.keys:
                    for piece in self._store.pieces(key):
                        digest.update(piece)
                        self.report.bytes += len(piece)
                        yield len(piece)
            if digest.hexdigest() != body.sha256:
                problem = "the body has another sha256 than its record says"
        for _ in body.keys:
            self._count(kind, 0)
        if problem and self._store.exists(body.record):
            self.report.findings.append(Finding(body.named, problem))
        yield 0

    def _file(
        self, kind: str, item: StoredObject, sha256: str, checked: CheckedObjects | None
    ) -> Iterator[int]:
        if checked is not None and self._max_age is not None and checked.is_fresh(item, self._max_age):
            self.report.fresh += 1
            return
        try:
            found = yield from self._sha256(item.key)
        except NotFound:  # collected meanwhile
            return
        if found == sha256:
            self._count(kind, 0)
            if checked is not None:
                checked.note(item)
            return
        if checked is not None:
            checked.drop(item.key)
        self._found(kind, item.key, "it has another sha256 than its name or manifest says", sha256)

    def _sha256(self, key: str) -> Generator[int, None, str]:
        digest = hashlib.sha256()
        for piece in self._store.pieces(key):
            digest.update(piece)
            self.report.bytes += len(piece)
            yield len(piece)
        return digest.hexdigest()

    def _records(self, items: list[StoredObject]) -> Iterator[int]:
        for item in items:
            form = form_of(item.key)
            if form is None:
                continue
            problem = self._why_unreadable(item.key, form)
            if problem:
                how = "" if self._repair is None else self._repair.record(item.key, form.kind)
                self.report.findings.append(Finding(item.key, f"the {form.kind.value}: {problem}", how))
            self._count(form.kind.value, item.size_bytes)
            yield item.size_bytes

    def _why_unreadable(self, key: str, form: RecordForm) -> str:
        """Reason why a record cannot be read; empty if it can, or was removed meanwhile."""
        try:
            form.check(key, self._store.get(key, max_bytes=max_bytes(form.kind)))
        except NotFound:
            return ""
        except (TooLarge, ValueError) as error:
            return str(error)
        return ""

    def _found(self, kind: str, key: str, problem: str, sha256: str | None = None) -> None:
        self._count(kind, 0)
        how = "" if self._repair is None or sha256 is None else self._repair.file(key, sha256)
        self.report.findings.append(Finding(key, problem, how))

    def _count(self, kind: str, size: int) -> None:
        self.report.kinds[kind] = self.report.kinds.get(kind, 0) + 1
        self.report.objects += 1
        self.report.bytes += size
