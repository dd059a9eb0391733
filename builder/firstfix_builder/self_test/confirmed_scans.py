"""The scans of confirmed queries, decoded for the self-test.

They lie in the work folder while a version is built, and in no stage: stages are kept, and shared with other
machines, when a recorded query has long been removed.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InputError
from firstfix.scan.compact import CompactScan
from firstfix.transform import pose_from_mapping

from ..job.confirmed_queries import ConfirmedQueries, ConfirmedQuery
from ..sources.read_map.held_out import Confirmation, HeldOut, HeldOutScan
from ..sources.read_map.read_map import content_hash
from ..sources.read_map.recorded_scan import read_recorded_scan

_OF_FILE = "of.txt"  # hash of the folder that was decoded


def decode_confirmed(folder: Path, into: Path) -> None:
    """Decode the folder of ``collect_confirmed``, unless it is done. ``HeldOut.load`` reads the result.

    Scans that cannot be read are left out with a reason.
    """
    digest = content_hash(folder)
    if (into / _OF_FILE).exists() and (into / _OF_FILE).read_text() == digest:
        return
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir(parents=True)
    told = ConfirmedQueries.load(folder)
    scans, left_out = [], dict(told.left_out)
    for query in told.queries:
        try:
            scans.append(_scan_of(folder, query))
        except (InputError, ValueError, KeyError, TypeError) as error:
            left_out[Path(query.file).name] = str(error)
    HeldOut(tuple(scans), left_out).save(into)
    (into / _OF_FILE).write_text(digest)


def _scan_of(folder: Path, query: ConfirmedQuery) -> HeldOutScan:
    scan = read_recorded_scan(folder / query.file, query.media_type, query.content_encoding, alone=True)
    if isinstance(scan, CompactScan):
        scan = replace(scan, described=None)  # by the parameters of the version that was asked
    options = LocalizeOptions.from_strings(query.options)
    if scan.time_s is None:
        options = replace(options, twist=None)
    confirmation = Confirmation(query.robot, query.told_by, query.told_at, options.to_strings())
    T_map_sensor = pose_from_mapping(query.T_map_sensor)
    return HeldOutScan(Path(query.file).name, scan, T_map_sensor, confirmation)
