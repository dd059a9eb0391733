"""Objects that a record describes: the bodies of recorded queries, and the parts of uploads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from ..catalog.recorded_queries import FOLDER as RECORDED
from ..catalog.recorded_queries import RecordedQueries
from ..catalog.uploads.parts import part_key, upload_folder
from ..catalog.uploads.record import parse_whole
from ..catalog.uploads.uploads import Uploads
from ..errors import NotFound, UnreadableRecord
from ..store.json_record import RecordKind, read_record
from ..store.store import Store


@dataclass(frozen=True)
class Body:
    """One body, in one object or several.

    Attributes:
        record: key of the record that describes it: without it there is no body.
        named: key that findings name: of several objects nobody can tell which one is wrong.
        keys: of its objects, in order.
        problem: why its objects cannot be those of the record; empty if their sizes are right.
        sha256: of the whole body; empty if no record has it.
    """

    record: str
    named: str
    keys: tuple[str, ...]
    problem: str
    sha256: str


def bodies_of_recorded_queries(store: Store) -> Iterator[Body]:
    """Bodies of all recorded queries whose record can be read."""
    recorded_queries = RecordedQueries(store)
    sizes = {item.key: item.size_bytes for item in store.scan(RECORDED)}
    for query_id in recorded_queries.ids():
        if (recorded := recorded_queries.find(query_id)) is None:
            continue
        key, size = f"{RECORDED}/{query_id}.body", sizes.get(f"{RECORDED}/{query_id}.body")
        problem = "" if size == recorded.body_bytes else f"its record says {recorded.body_bytes} bytes"
        if problem:
            problem = f"it has {size} bytes, {problem}" if size is not None else f"it is missing: {problem}"
        yield Body(f"{RECORDED}/{query_id}.json", key, (key,), problem, recorded.body_sha256)


def bodies_of_uploads(store: Store) -> Iterator[Body]:
    """Parts of all uploads whose record can be read."""
    uploads = Uploads(store)
    for upload_id in uploads.ids():
        folder = upload_folder(upload_id)
        try:
            upload = uploads.get(upload_id)
        except (NotFound, UnreadableRecord):
            continue
        sha256 = upload.sha256 or ""
        was_whole = False
        with suppress(NotFound, UnreadableRecord):
            sha256 = read_record(store, f"{folder}/whole.json", RecordKind.UPLOAD_WHOLE, parse_whole)
            was_whole = True
        offsets = [sum(upload.parts[:number]) for number in range(len(upload.parts))]
        keys = [part_key(upload_id, offset) for offset in offsets]
        # Of an upload under way nobody knows where its last part ends: only later parts tell.
        beyond = set(store.list(f"{folder}/parts")) - set(keys)
        problem = ""
        if not upload.complete and (was_whole or beyond):
            problem = f"a part is missing or cut off at byte {upload.offset} of {upload.size_bytes}"
        record = f"{folder}/upload.json"
        yield Body(record, record, tuple(keys), problem, sha256 if upload.complete else "")
