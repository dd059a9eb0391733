"""Kinds of records in a store: the keys of each kind, and its parser."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..access.api_keys import parse_key
from ..builds.attempts import parse_attempt
from ..builds.callers import parse_claim
from ..builds.records import parse_request, parse_stages, parse_status
from ..builds.shared_stages import parse_stage
from ..catalog.georeferences import parse_georeference
from ..catalog.log.change_log import parse_notice
from ..catalog.log.map_state import LogEntry, MapState
from ..catalog.recorded_queries import parse_recorded_query
from ..catalog.sightings.record import SightingsRecord
from ..catalog.uploads.record import UploadRecord, parse_whole
from ..store.json_record import RecordKind, max_bytes, parse_record
from .checked_objects import parse_checked

FOLDERS = (
    "builds",
    "changes",
    "checked",
    "idempotency",
    "keys",
    "maps",
    "recorded-queries",
    "stages",
    "uploads",
)


@dataclass(frozen=True)
class RecordForm:
    """Keys and parser of one kind of record.

    Attributes:
        pattern: pattern of its keys; the parser gets its group.
        parse: takes the group and the JSON object.
    """

    kind: RecordKind
    pattern: re.Pattern[str]
    parse: Callable[[str, Any], object]

    def check(self, key: str, data: bytes) -> None:
        """Parse a record.

        Raises:
            ValueError: the record is damaged.
        """
        match = self.pattern.fullmatch(key)
        group = match[1] if match is not None and match.lastindex else ""
        if len(data) > max_bytes(self.kind):
            raise ValueError(f"it has {len(data)} bytes, too many for its kind")
        parse_record(data, self.kind, lambda record: self.parse(group, record))


def _form(kind: RecordKind, pattern: str, parse: Callable[[str, Any], object]) -> RecordForm:
    return RecordForm(kind, re.compile(pattern), parse)


FORMS = (
    _form(RecordKind.BUILD_REQUEST, r"builds/[^/]+/request\.json", lambda _, r: parse_request(r)),
    _form(RecordKind.BUILD_STATUS, r"builds/[^/]+/status\.json", lambda _, r: parse_status(r)),
    _form(RecordKind.BUILD_STAGES, r"builds/[^/]+/stages\.json", lambda _, r: parse_stages(r)),
    _form(
        RecordKind.BUILD_ATTEMPT,
        r"builds/[^/]+/attempts/\d{6,}(?:\.end)?\.json",
        lambda _, r: parse_attempt(r),
    ),
    _form(RecordKind.LOG_ENTRY, r"maps/[^/]+/log/(\d{6,})\.json", lambda seq, r: LogEntry.parse(int(seq), r)),
    _form(
        RecordKind.LOG_SNAPSHOT,
        r"maps/[^/]+/snapshots/(\d{6,})\.json",
        lambda seq, r: MapState.parse(int(seq), r),
    ),
    _form(
        RecordKind.GEOREFERENCE,
        r"maps/[^/]+/georeference/\d{6,}\.json",
        lambda _, r: parse_georeference(r),
    ),
    _form(RecordKind.CHANGE_NOTICE, r"changes/\d{8,}\.json", lambda _, r: parse_notice(r)),
    _form(RecordKind.UPLOAD, r"uploads/[^/]+/upload\.json", lambda _, r: UploadRecord.parse(r)),
    _form(RecordKind.UPLOAD_WHOLE, r"uploads/[^/]+/whole\.json", lambda _, r: parse_whole(r)),
    _form(RecordKind.API_KEY, r"keys/([0-9a-f]{12})\.json", parse_key),
    _form(RecordKind.RECORDED_QUERY, r"recorded-queries/[^/]+\.json", lambda _, r: parse_recorded_query(r)),
    _form(RecordKind.IDEMPOTENCY_KEY, r"idempotency/[0-9a-f]{64}", lambda _, r: parse_claim(r)),
    _form(RecordKind.SHARED_STAGE, r"stages/[0-9a-f]{64}/stage\.json", lambda _, r: parse_stage(r)),
    _form(
        RecordKind.SIGHTINGS,
        r"maps/[^/]+/versions/[^/]+/sightings/(?:merged/)?[^/]+\.json",
        lambda _, r: SightingsRecord.parse(r),
    ),
    _form(RecordKind.CHECKED_OBJECTS, r"checked/[^/]+\.json", lambda _, r: parse_checked(r)),
)


def form_of(key: str) -> RecordForm | None:
    """Form of the record under a key; None if the key is not that of a record."""
    return next((form for form in FORMS if form.pattern.fullmatch(key)), None)


def why_unreadable(key: str, data: bytes) -> str | None:
    """Reason why a record cannot be read; None if it can, or if the key is not that of a record."""
    form = form_of(key)
    try:
        if form is not None:
            form.check(key, data)
    except ValueError as error:
        return str(error)
    return None
