"""The one way to read a JSON record of a store: bounded, a JSON object, and of the form of its kind.

A record that cannot be read is an error of that record alone: ``UnreadableRecord``, which names it. Whoever
goes through many records passes it over. Each such record is told once to ``Store.unreadable``, which logs
and counts it.
"""

from __future__ import annotations

import json
import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from ..errors import FirstfixError, TooLarge, UnreadableRecord

if TYPE_CHECKING:
    from .store import Store

_log = logging.getLogger(__name__)
T = TypeVar("T")
K = TypeVar("K")
READERS = 8  # records that are read at the same time: a store far away takes tens of milliseconds for each
_REMEMBERED = 10_000  # unreadable records that were told of


class RecordKind(str, Enum):
    """Kinds of records: a label of the metric."""

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
    SAMPLE = "sample"
    IDEMPOTENCY_KEY = "idempotency_key"
    GEOREFERENCE = "georeference"
    SHARED_STAGE = "shared_stage"
    CHECKED_OBJECTS = "checked_objects"


_USUAL_BYTES = 1 << 20
_MAX_BYTES = {
    RecordKind.BUILD_REQUEST: 4 << 20,
    RecordKind.LOG_ENTRY: 64 << 10,
    RecordKind.LOG_SNAPSHOT: 64 << 20,
    RecordKind.API_KEY: 64 << 10,
    RecordKind.CHANGE_NOTICE: 64 << 10,
    RecordKind.SAMPLE: 4 << 20,
    RecordKind.SHARED_STAGE: 4 << 20,
    RecordKind.CHECKED_OBJECTS: 64 << 20,
}


def read_record(store: Store, key: str, kind: RecordKind, parse: Callable[[Any], T]) -> T:
    """The record under a key, as its kind's parser gives it.

    Args:
        parse: gets the JSON object, or None for a georeference's ``null``. A ValueError, KeyError,
            TypeError, AttributeError or FirstfixError of it says that the record is none of its kind.

    Raises:
        NotFound: no such key.
        UnreadableRecord: the record is damaged, or of a form that this release does not know.
        StoreUnavailable, StoreError: as the store.
    """
    try:
        data = store.get(key, max_bytes=max_bytes(kind))
        found = parse_record(data, parse, nullable=kind is RecordKind.GEOREFERENCE)
    except (TooLarge, ValueError) as error:
        told = UnreadableRecord(f"{key} cannot be read: {error}", kind.value, key)
        store.unreadable.tell(told)
        raise told from None
    store.unreadable.forget(key)
    return found


def parse_record(data: bytes, parse: Callable[[Any], T], *, nullable: bool = False) -> T:
    """
    Args:
        nullable: ``null`` is a record too.

    Raises:
        ValueError: it is no JSON object, or not of the form that the parser wants.
    """
    try:
        record = json.loads(data, parse_constant=_refuse)
        if not isinstance(record, dict) and not (nullable and record is None):
            raise ValueError("it is no JSON object")
        return parse(record)
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None
    except FirstfixError as error:
        raise ValueError(str(error)) from None


def read_each(keys: Iterable[K], read: Callable[[K], T]) -> dict[K, T]:
    """Results of ``read`` for each key, a few at the same time. Raises its first error."""
    wanted = list(keys)
    if len(wanted) < 2:
        return {key: read(key) for key in wanted}
    with ThreadPoolExecutor(min(READERS, len(wanted)), thread_name_prefix="records") as readers:
        return dict(zip(wanted, readers.map(read, wanted), strict=True))


def max_bytes(kind: RecordKind) -> int:
    """Size over which a record of that kind is not read."""
    return _MAX_BYTES.get(kind, _USUAL_BYTES)


def text_of(record: Mapping[str, Any], name: str, default: str | None = None) -> str:
    """A field that is a text. Without a default it has to be there.

    Raises:
        KeyError, TypeError, ValueError: it is not, or cannot be written as UTF-8.
    """
    value = record[name] if default is None else record.get(name, default)
    if not isinstance(value, str):
        raise TypeError(f"{name} is no text")
    value.encode()  # lone surrogates: they would fail whoever answers with it
    return value


def texts_of(record: Mapping[str, Any], name: str) -> list[str]:
    """A field that is a list of texts.

    Raises:
        KeyError, TypeError: it is not.
    """
    values = record[name]
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise TypeError(f"{name} is no list of texts")
    return values


def whole_number_of(record: Mapping[str, Any], name: str) -> int:
    """A field that is a whole number from 0.

    Raises:
        KeyError, TypeError: it is not.
    """
    value = record[name]
    if type(value) is not int or value < 0:
        raise TypeError(f"{name} is no whole number from 0")
    return value


class UnreadableRecords:
    """Which records of a store could not be read. Thread-safe. Each is told once, and once more if it was
    mended in between."""

    def __init__(self) -> None:
        self._known: OrderedDict[str, None] = OrderedDict()
        self._listeners: list[Callable[[UnreadableRecord], None]] = []
        self._lock = threading.Lock()

    def listen(self, listener: Callable[[UnreadableRecord], None]) -> None:
        """Calls it for every record that is found unreadable from now on."""
        self._listeners.append(listener)

    def tell(self, error: UnreadableRecord) -> None:
        with self._lock:
            if error.key in self._known:
                return
            self._known[error.key] = None
            while len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
        _log.warning("unreadable %s: %s", error.kind, error)
        for listener in self._listeners:
            listener(error)

    def forget(self, key: str) -> None:
        """It can be read again."""
        if self._known:
            with self._lock:
                self._known.pop(key, None)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no JSON")
