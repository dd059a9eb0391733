"""Reads the recorded queries of a patch as observations."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from firstfix.errors import InputError
from firstfix.transform import pose_from_mapping

from ...job.patch_source import PatchSource
from ..read_map.recorded_scan import read_recorded_scan
from .observation import Observation


def read_observations(folder: Path, source: PatchSource) -> list[Observation]:
    """The observations in the folder of a patch. Scans that cannot be read, and descriptors, are left out."""
    return list(_each(folder, source))


def _each(folder: Path, source: PatchSource) -> Iterator[Observation]:
    for query in source.queries:
        try:
            scan = read_recorded_scan(folder / query.file, query.media_type, query.content_encoding)
        except InputError:
            continue
        twist = query.answer.get("twist")
        yield Observation(
            query.robot,
            query.time_s,
            scan,
            pose_from_mapping(query.answer["T_map_sensor"]),
            None if twist is None else np.array([*twist["linear"], *twist["angular"]], np.float64),
        )
