"""JSON records of a store: the one way to write and read them, with limits on size and parsers by kind.

A record carries a checksum, so that no flipped bit passes for a value: ``record_json`` writes it, and every
reader checks it.

A damaged record is an error of that record alone: ``UnreadableRecord`` names it, and a caller that reads many
records skips it. Each such record is reported once to ``Store.unreadable``, which logs and counts it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from typing import Any, NoReturn, TypeVar

from ..errors import FirstfixError, TooLarge, UnreadableRecord
from .store import Store

T = TypeVar("T")
K = TypeVar("K")
READERS = 8  # records read at the same time: a remote store takes tens of milliseconds for each
CHECKSUM = "checksum"  # the field's name


class RecordKind(str, Enum):
    """Kinds of records; also the values of a metric's label."""

    BUILD_REQUEST = "build_request"
    BUILD_STATUS = "build_status"
    BUILD_STAGES = "build_stages"
    BUILD_ATTEMPT = "build_attempt"
    LOG_ENTRY = "log_entry"
    LOG_SNAPSHOT = "log_snapshot"
    CHANGE_NOTICE = "change_notice"
    UPLOAD = "upload"
    UPLOAD_WHOLE = "upload_whole"
    API_KEY = "api_key"
    RECORDED_QUERY = "recorded_query"
    IDEMPOTENCY_KEY = "idempotency_key"
    GEOREFERENCE = "georeference"
    SHARED_STAGE = "shared_stage"
    CHECKED_OBJECTS = "checked_objects"
    SIGHTINGS = "sightings"


_USUAL_BYTES = 1 << 20
_MAX_BYTES = {
    RecordKind.BUILD_REQUEST: 4 << 20,
    RecordKind.LOG_ENTRY: 64 << 10,
    RecordKind.LOG_SNAPSHOT: 64 << 20,
    RecordKind.API_KEY: 64 << 10,
    RecordKind.CHANGE_NOTICE: 64 << 10,
    RecordKind.RECORDED_QUERY: 4 << 20,
    RecordKind.SHARED_STAGE: 4 << 20,
    RecordKind.CHECKED_OBJECTS: 64 << 20,
    RecordKind.SIGHTINGS: 64 << 20,
}


def record_json(record: Mapping[str, Any]) -> bytes:
    """Content of a record's object, with its checksum.

    Args:
        record: values that come back from JSON as they are; the keys of objects are texts.

    Raises:
        ValueError, TypeError: a value has no JSON form.
    """
    values = {**record, CHECKSUM: _checksum_of(record)}
    return json.dumps(values, sort_keys=True, allow_nan=False).encode("ascii")


def read_record(store: Store, key: str, kind: RecordKind, parse: Callable[[Any], T]) -> T:
    """Read the record under a key and parse it.

    Args:
        parse: takes the JSON object without its checksum, or None for a georeference's ``null``. It raises
            ValueError, KeyError, TypeError, AttributeError or FirstfixError if the object is not a record of
            this kind.

    Raises:
        NotFound: no such key.
        UnreadableRecord: the record is damaged, or this release does not know its form.
        StoreUnavailable, StoreError: the store failed.
    """
    try:
        data = store.get(key, max_bytes=max_bytes(kind))
        found = parse_record(data, kind, parse)
    except (TooLarge, ValueError) as error:
        unreadable = UnreadableRecord(f"{key} cannot be read: {error}", kind.value, key)
        store.unreadable.report(unreadable)
        raise unreadable from None
    store.unreadable.forget(key)
    return found


def parse_record(data: bytes, kind: RecordKind, parse: Callable[[Any], T]) -> T:
    """Decode and parse a record.

    Raises:
        ValueError: the data is not a JSON object, its checksum is missing or wrong, or the parser refuses it.
    """
    try:
        record = json.loads(data, parse_constant=_refuse)
        if not (record is None and kind is RecordKind.GEOREFERENCE):
            if not isinstance(record, dict):
                raise ValueError("it is not a JSON object")
            if record.pop(CHECKSUM, None) != _checksum_of(record):
                raise ValueError("its checksum is missing or wrong")
        return parse(record)
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None
    except FirstfixError as error:
        raise ValueError(str(error)) from None


def read_each(keys: Iterable[K], read: Callable[[K], T]) -> dict[K, T]:
    """Call ``read`` for each key, several at the same time. Raises the first error."""
    wanted = list(keys)
    if len(wanted) < 2:
        return {key: read(key) for key in wanted}
    with ThreadPoolExecutor(min(READERS, len(wanted)), thread_name_prefix="records") as readers:
        return dict(zip(wanted, readers.map(read, wanted), strict=True))


def max_bytes(kind: RecordKind) -> int:
    """Largest size of a record of a kind: a larger one is not read."""
    return _MAX_BYTES.get(kind, _USUAL_BYTES)


def text_of(record: Mapping[str, Any], name: str, default: str | None = None) -> str:
    """Text field of a record. Required unless there is a default.

    Raises:
        KeyError, TypeError, ValueError: the field is missing, is not text, or cannot be written as UTF-8.
    """
    value = record[name] if default is None else record.get(name, default)
    if not isinstance(value, str):
        raise TypeError(f"{name} is not a text")
    value.encode()  # refuses lone surrogates, which no answer could contain
    return value


def texts_of(record: Mapping[str, Any], name: str) -> list[str]:
    """List of texts in a field of a record.

    Raises:
        KeyError, TypeError: the field is missing or is not a list of texts.
    """
    values = record[name]
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise TypeError(f"{name} is not a list of texts")
    return values


def whole_number_of(record: Mapping[str, Any], name: str) -> int:
    """Whole number of at least 0 in a field of a record.

    Raises:
        KeyError, TypeError: the field is missing or is not such a number.
    """
    value = record[name]
    if type(value) is not int or value < 0:
        raise TypeError(f"{name} is not a whole number of at least 0")
    return value


def _checksum_of(values: Mapping[str, Any]) -> str:
    """SHA-256 of the one JSON form of values: sorted keys, no spaces, ASCII."""
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not JSON")
