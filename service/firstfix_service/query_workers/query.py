"""One query and what answers it: the same in a thread of the service and in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.decode import decode_query, undo_content_encoding
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, SearchesMap, localize_among
from firstfix.engine.stopwatch import Stopwatch
from firstfix.scan.sequence import AnyScan


class LocalizesScans(SearchesMap, Protocol):
    def localize(self, scan: AnyScan, options: LocalizeOptions | None = None) -> Localization: ...


@dataclass(frozen=True)
class ServedVersion:
    """A version whose files are on this machine, every one of them verified."""

    map_id: str
    version: str
    directory: Path


@dataclass(frozen=True)
class Query:
    """Attributes:
    body: as it came, with its Content-Encoding.
    versions: of different maps; where there are several, their places compete.
    """

    body: bytes
    media_type: str
    content_encoding: str
    options: LocalizeOptions
    versions: tuple[ServedVersion, ...]
    max_decoded_bytes: int


def load_localizer(directory: Path) -> LocalizesScans:
    return Localizer(MapIndex.load(directory))


def answer_query(query: Query, localizers: Sequence[LocalizesScans]) -> Localization:
    """The answer, with the time that decoding took and the version that it is of.

    Args:
        localizers: of ``query.versions``.

    Raises:
        InputError: the body or an option cannot be used.
    """
    watch = Stopwatch()
    with watch.stage("decode"):
        plain = undo_content_encoding(query.body, query.content_encoding, query.max_decoded_bytes)
        scan = decode_query(plain, query.media_type)
    by_map = {one.map_id: one for one in query.versions}
    if len(localizers) == 1:
        (answered,) = query.versions
        answer = localizers[0].localize(scan, query.options)
    else:
        answer = localize_among(dict(zip(by_map, localizers, strict=True)), scan, query.options)
        # where none is sure, the map of the best place, if there is a place at all
        answered = by_map[answer.hypotheses[0].map_id] if answer.hypotheses else query.versions[0]
    return replace(
        answer,
        map_id=answered.map_id,
        map_version=answered.version,
        timings_ms={**watch.ms, **answer.timings_ms},
    )
