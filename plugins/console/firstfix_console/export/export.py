"""Export of one map with its recorded queries."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Protocol

from firstfix.errors import InvalidOption

from .exported_query import ExportedQuery, exported_queries, read_scan
from .map_cloud import MapCloud, read_map_cloud
from .new_file import new_file
from .source import ExportSource

ENDINGS = (".mcap", ".rrd")


class ViewerFile(Protocol):
    """A file that is being written."""

    def write_map(self, cloud: MapCloud, time_ns: int) -> None:
        """Write the map, which is there from ``time_ns`` on."""

    def write_query(self, query: ExportedQuery) -> None:
        """Write one query with its answer."""


@dataclass
class Exported:
    """Result of an export.

    Attributes:
        version: of the map, whose cloud it is.
        note: why there is no cloud; empty if there is one.
        unreadable: queries without points, because these could not be read.
    """

    version: str
    points: int = 0
    queries: int = 0
    localized: int = 0
    unreadable: int = 0
    note: str = ""


def export(
    source: ExportSource,
    map_id: str,
    path: Path,
    *,
    version: str | None,
    most_points: int,
    count: int | None,
    force: bool,
) -> Exported:
    """Write a map with its recorded queries. The file appears when it is whole.

    The memory that this takes does not depend on the number of the queries.

    Args:
        version: whose cloud is written; None: the active one.
        most_points: of the cloud.
        count: the newest so many queries; None: all.
        force: replace a file that is there.

    Raises:
        InvalidOption: the ending of the path is neither .mcap nor .rrd.
        Conflict: the file is there, and ``force`` is not set.
        NotFound: no such map or version.
    """
    if path.suffix not in ENDINGS:
        raise InvalidOption(f"{path}: the file's name must end with {' or '.join(ENDINGS)}")
    with new_file(path, force=force) as folder:
        shown = source.full_version(version) if version else source.active_version()
        queries = exported_queries(
            islice(source.recorded_queries(), count), map_id, partial(read_scan, source)
        )
        return write_viewer_file(source, map_id, shown, folder, path.suffix, most_points, queries)


def write_viewer_file(
    source: ExportSource,
    map_id: str,
    version: str,
    folder: Path,
    ending: str,
    most_points: int,
    queries: Iterable[ExportedQuery],
) -> Exported:
    """Write the file ``out`` into a folder.

    Args:
        version: all of its characters.
        ending: of ENDINGS.

    Raises:
        NotFound: no such version.
        ModuleNotFoundError: what writes such a file is not installed.
    """
    found = Exported(version)
    cloud = _cloud_of(source, found, most_points)
    with _viewer_file(folder, ending, map_id) as file:
        first_ns = None
        for query in queries:
            file.write_query(query)
            first_ns = min(first_ns or query.time_ns, query.time_ns)
            found.queries += 1
            found.localized += query.localized
            found.unreadable += bool(query.unreadable)
        if cloud is not None:
            file.write_map(cloud, first_ns or time.time_ns())
    return found


def _cloud_of(source: ExportSource, found: Exported, most_points: int) -> MapCloud | None:
    index = source.cloud(found.version)
    if index is None:
        found.note = f"version {found.version[:12]} has no cloud for viewers: build the map again to get one"
        return None
    cloud = read_map_cloud(
        index,
        partial(source.cloud_points, found.version),
        partial(source.cloud_intensity, found.version),
        most_points,
    )
    found.points = len(cloud.points)
    return cloud


@contextmanager
def _viewer_file(folder: Path, ending: str, map_id: str) -> Iterator[ViewerFile]:
    if ending == ".mcap":
        from .mcap_file import mcap_file

        with mcap_file(folder) as mcap:
            yield mcap
        return
    from .rrd_file import rrd_file

    with rrd_file(folder, f"firstfix {map_id}") as rrd:
        yield rrd
