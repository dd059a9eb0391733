"""Reads the scans of kept queries, which come from robots: bytes of strangers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from firstfix.decode import decode_query
from firstfix.errors import InputError
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import pose_from_mapping
from firstfix.wire.content_encoding import undo_content_encoding

from ..job.patch_source import KeptQuery, PatchSource
from .observation import Observation

MOST_DECODED_BYTES = 64 << 20
MOST_POINTS = 1_000_000


def read_observations(folder: Path, source: PatchSource) -> list[Observation]:
    """The observations in the folder of a patch. Scans that cannot be read, and descriptors, are left out."""
    return list(_each(folder, source))


def _each(folder: Path, source: PatchSource) -> Iterator[Observation]:
    for query in source.queries:
        scan = _scan_of(folder, query)
        if scan is None:
            continue
        twist = query.answer.get("twist")
        yield Observation(
            query.robot,
            query.time_s,
            scan,
            pose_from_mapping(query.answer["T_map_sensor"]),
            None if twist is None else np.array([*twist["linear"], *twist["angular"]], np.float64),
        )


def _scan_of(folder: Path, query: KeptQuery) -> Scan | CompactScan | None:
    try:
        body = undo_content_encoding(
            (folder / query.file).read_bytes(), query.content_encoding, MOST_DECODED_BYTES
        )
        scan = decode_query(body, query.media_type)
    except InputError:
        return None
    last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
    if not isinstance(last, Scan | CompactScan) or len(last.points) > MOST_POINTS:
        return None
    return last
