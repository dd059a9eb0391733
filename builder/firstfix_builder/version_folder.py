"""The folder of a version: the files of its stages, and the manifest that lists them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import ENGINE_FILE
from firstfix.engine.index import MAP_FILE
from firstfix.engine.retrieval.cascade import Clusters
from firstfix.transform import Matrix

from .execution.stage_cache import StageResult
from .job.build_job import BuildResult
from .rebuild.base_version import REBUILT
from .rebuild.kept import TAUGHT_ANEW, Kept
from .self_test.compare_versions import ComparedVersions
from .sources.patch_reader import PATCH_FILE, PatchedMap
from .stage_files import link
from .stage_results import REPORT_FILE, LevelMap


def collect_version(
    config: BuildConfig,
    read: LevelMap,
    parts: Sequence[StageResult],
    directory: Path,
    *,
    provisional: bool = False,
    compared: ComparedVersions | None = None,
    kept: Kept | None = None,
) -> BuildResult:
    """Make a version's folder of the files of all parts, linked where that works, and write its manifest.

    The config names the base of which something is kept, and none else.
    """
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir(parents=True)
    for path in sorted(path for part in parts for path in part.directory.iterdir()):
        link(path, directory / path.name)
    if compared is not None:
        link(PatchedMap.of(read).patch, directory / PATCH_FILE)
    config = config.model_copy(update={"base": None if kept is None else kept.base.digest})
    source = _source_record(read, compared)
    if kept is not None:
        tested = json.loads((directory / REPORT_FILE).read_text())
        source[REBUILT] = kept.record(is_taught_anew=bool(tested.get(TAUGHT_ANEW)))
    return BuildResult(
        directory, write_manifest(directory, config, read.T_map_level, source, provisional=provisional)
    )


def write_manifest(
    directory: Path,
    config: BuildConfig,
    T_map_level: Matrix,
    source: Mapping[str, Any],
    *,
    provisional: bool,
) -> Manifest:
    """Write the manifest of a version's files beside them."""
    points = np.load(directory / MAP_FILE, mmap_mode="r")
    clusters = Clusters.load(directory)
    report = directory / REPORT_FILE
    manifest = Manifest.for_directory(
        directory,
        engine=json.loads((directory / ENGINE_FILE).read_text()),
        config=config.to_mapping(),
        sensor=config.sensor_model.to_mapping(),
        origin=T_map_level[:3, 3],
        source=source,
        counts={
            "templates": len(clusters.member),
            "clusters": len(clusters),
            "map_points": len(points),
        },
        self_test=json.loads(report.read_text()) if report.exists() else {},
        provisional=provisional,
        bounds=(points.min(axis=0), points.max(axis=0)),
    )
    (directory / "manifest.json").write_bytes(manifest.to_json())
    return manifest


def _source_record(read: LevelMap, compared: ComparedVersions | None) -> dict[str, Any]:
    """Record of the source: its digest and findings, the transform of each session, and the patch."""
    found: dict[str, Any] = {"sha256": read.digest, "findings": read.findings}
    if (sessions := read.sessions) is not None:
        found["sessions"] = sessions
    if compared is not None:
        found["patch"] = {**PatchedMap.of(read).record, "compared": compared.record}
    return found
