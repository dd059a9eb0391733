"""One query, and how it is answered: the same code in a thread and in a worker process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.stopwatch import Stopwatch

from .body_format import BodyFormat


@dataclass(frozen=True)
class ServedVersion:
    """A map version whose files are on this machine and verified."""

    map_id: str
    version: str
    directory: Path


@dataclass(frozen=True)
class Query:
    """A query for a worker: everything but the body is parsed already.

    Attributes:
        body: as it came, with its content encoding.
        versions: of different maps; where there are several, their places compete.
    """

    body: bytes
    body_format: BodyFormat
    options: LocalizeOptions
    versions: tuple[ServedVersion, ...]
    max_decoded_bytes: int


def load_localizer(directory: Path) -> Localizer:
    """Returns the localizer of a version's folder."""
    return Localizer(MapIndex.load(directory))


def answer_query(query: Query, localizers: Sequence[Localizer]) -> Localization:
    """Returns the answer with its map version and the time of decoding.

    Args:
        localizers: one for each of ``query.versions``.

    Raises:
        InputError: the body or an option cannot be used.
    """
    watch = Stopwatch()
    with watch.stage("decode"):
        scan = query.body_format.scan_of(query.body, query.max_decoded_bytes)
    by_map = {one.map_id: one for one in query.versions}
    if len(localizers) == 1:
        (answered,) = query.versions
        answer = localizers[0].localize(scan, query.options)
    else:
        answer = localize_among(dict(zip(by_map, localizers, strict=True)), scan, query.options)
        # If no map is sure: the map of the best hypothesis, if there is one.
        answered = by_map[answer.hypotheses[0].map_id] if answer.hypotheses else query.versions[0]
    return replace(
        answer,
        map_id=answered.map_id,
        map_version=answered.version,
        timings_ms={**watch.ms, **answer.timings_ms},
    )
