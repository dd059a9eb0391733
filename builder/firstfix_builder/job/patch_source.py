"""Source of a patch: a folder with the map's files, the version to patch, and recorded queries of robots.

Its files:

patch.json         ``PatchSource``
source/...         file of the map
trajectory/...     poses of the mapping run, if the map has them
base/...           files of the version to patch
queries/<id>       bodies of the queries, as they came
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.engine.changes.areas import Area, find_areas
from firstfix.errors import NotFound, NothingToPatch, UnreadableRecord

from ..stage_files import link, link_all
from .recorded_queries import chosen_queries

_log = logging.getLogger(__name__)
PATCH_SOURCE_FILE, BASE = "patch.json", "base"
MAX_BYTES = 1 << 30


@dataclass(frozen=True)
class PatchQuery:
    """A localized query of a robot, without its body.

    Attributes:
        file: path of the body below the folder.
        robot: pseudonym of its credential.
        time_s: seconds since 1970.
        answer: ``T_map_sensor`` and ``twist``, in the form of ``Localization.to_mapping``.
    """

    file: str
    robot: str
    time_s: float
    media_type: str
    content_encoding: str
    answer: Mapping[str, Any]


@dataclass(frozen=True)
class PatchSource:
    """Content of ``patch.json``. Paths are relative to its folder.

    Attributes:
        source: file of the map.
        trajectory: poses of its mapping run, or None.
        base: digest of the version to patch; its files are below ``BASE``.
        queries: that it has answered, the oldest first.
    """

    source: str
    trajectory: str | None
    base: str
    queries: tuple[PatchQuery, ...]

    def save(self, folder: Path) -> None:
        """Write ``patch.json``."""
        (folder / PATCH_SOURCE_FILE).write_text(json.dumps(asdict(self), sort_keys=True))

    @classmethod
    def load(cls, folder: Path) -> PatchSource:
        """Read what ``save`` wrote."""
        found = json.loads((folder / PATCH_SOURCE_FILE).read_text())
        return cls(**{**found, "queries": tuple(PatchQuery(**one) for one in found["queries"])})


def is_patch_source(source: Path) -> bool:
    """Whether a source is such a folder."""
    return source.is_dir() and (source / PATCH_SOURCE_FILE).is_file()


def collect_patch_source(
    catalog: Catalog,
    recorded_queries: RecordedQueries,
    map_id: str,
    base: str,
    files: Mapping[str, Path],
    folder: Path,
    on_progress: Callable[[float], None] = lambda done: None,
) -> Path:
    """Make the folder. Returns it.

    Args:
        base: version to patch.
        files: of the base's build, by role: ``source``, and ``trajectory`` if it had one.
        on_progress: called with the share that is done, 0..1.

    Raises:
        NothingToPatch: no recorded query counts.
        NotFound, VersionError, StoreError: the version or the queries cannot be read.
    """
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "queries").mkdir(parents=True)
    kept, size = [], 0
    areas = _areas_of(catalog, map_id, base)
    chosen = chosen_queries(recorded_queries, map_id, base, areas, lambda done: on_progress(done / 2))
    for number, one in enumerate(chosen):
        on_progress((1 + number / len(chosen)) / 2)
        recorded = one.recorded
        size += recorded.body_bytes
        if size > MAX_BYTES:
            break
        try:
            body = recorded_queries.body(recorded.query_id)
        except (NotFound, UnreadableRecord):
            continue  # removed meanwhile, or damaged
        name = f"queries/{recorded.query_id}"
        (folder / name).write_bytes(body)
        answer = {key: recorded.answer.get(key) for key in ("T_map_sensor", "twist")}
        kept.append(
            PatchQuery(
                name, recorded.robot, one.time_s, recorded.media_type, recorded.content_encoding, answer
            )
        )
    if not kept:
        raise NothingToPatch(
            f"nothing to patch: no recorded query of a robot with a key of its own was localized in version "
            f"{base[:12]} (FIRSTFIX_RECORDED_SHARE_LOCALIZED)"
        )
    fetched = catalog.fetch_version(map_id, base, folder / "fetched")
    link_all(fetched, folder / BASE)
    named = {role: _linked(path, folder / role) for role, path in files.items()}
    source = PatchSource(named["source"], named.get("trajectory"), base, tuple(kept))
    source.save(folder)
    shutil.rmtree(folder / "fetched", ignore_errors=True)
    _log.info("%d recorded queries of %d robots count", len(kept), len({one.robot for one in kept}))
    return folder


def _areas_of(catalog: Catalog, map_id: str, version: str) -> list[Area]:
    """The areas that the counts of the version's queries show: where a patch has something to look at."""
    record = Sightings(catalog.store).read(catalog.folder_of(map_id, version))
    return find_areas(record.newest_first())


def _linked(path: Path, folder: Path) -> str:
    """Put a file into a folder. Returns its path below that folder's parent."""
    folder.mkdir()
    link(path, folder / path.name)
    return f"{folder.name}/{path.name}"
