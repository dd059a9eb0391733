"""read_source: the map of any source, by the reader of its kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from firstfix.doors import SOURCES

from ..stage_results import LevelMap
from .archive_reader import ArchiveReader
from .map_reader import MapReader
from .patch_reader import PatchReader
from .reading import Reading, SourceReader
from .sessions_reader import SessionsReader


@cache
def readers() -> Mapping[str, SourceReader]:
    """All readers by name, in the order in which they are asked. A source within another is for a later one.

    Those of other packages come before the last, which takes every file and folder.
    """
    return {
        "patch": PatchReader(),
        "archive": ArchiveReader(),
        "sessions": SessionsReader(),
        **dict(_of_other_packages()),
        "map": MapReader(),
    }


def read_source(path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
    """The map of a source: of a file, an archive, the folder of a SLAM package, sessions, or a patch.

    Args:
        trajectory: poses of the mapping run, if they are not in the source.

    Raises:
        InputError: the source or the trajectory cannot be read.
        BuildFailed: a finding refuses the map, or its sessions or its patch cannot be used.
    """
    return reading.first_of(readers(), path, trajectory)


def _of_other_packages() -> Iterator[tuple[str, SourceReader]]:
    """Readers by name and version: another version does not take the results of the former one."""
    for point in sorted(entry_points(group=SOURCES), key=lambda point: (point.name, point.value)):
        yield _name_of(point), point.load()


def _name_of(point: EntryPoint) -> str:
    package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
    return f"{point.name} of {package}: {point.value}"
