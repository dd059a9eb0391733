"""Scans that a map was made from, with their poses.

A map's folder brings them in a folder of their own. Without a map file beside it, they are the map
(``map_of_scans.py``).

    mapping_scans/poses.csv    columns scan (path from this folder) and tx,ty,tz,qx,qy,qz,qw (T_map_sensor)
    mapping_scans/...          the scans, as ``firstfix localize`` reads them

Folders of other programs are read the same (``scan_folders.py``).
What cannot be used is left out with a reason: the map is built all the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from posixpath import normpath

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InputError, NotFound
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .posed_scans import pose_of, read_posed_scan, why_not_read
from .scan_folders import FOLDER, Row, scan_folder_in


class MappingScans:
    """The scans of a map's folder, of which one is in memory at a time.

    Args:
        without: names of scans that do not count.

    Attributes:
        program: that left the folder; empty: our own form.
        name: of the folder in messages.
        left_out: the reason for each scan, by its name, or for the file of poses.
    """

    def __init__(self, source: Path, axis: str, scale: float = 1.0, *, without: Collection[str] = ()) -> None:
        self.left_out: dict[str, str] = {}
        self.program, self.name = "", FOLDER
        self._folder = source / FOLDER
        self._rows: list[Row] = []
        found = scan_folder_in(source)
        if found is None:
            return
        self.program, self.name, self._folder = found.program, found.name, found.folder
        reason = why_not_read(axis, scale)
        if reason is not None:
            self.left_out[self.name] = reason
            return
        try:
            self._rows = [row for row in self._each_once(found.rows()) if row[0] not in without]
        except (InputError, NotFound) as error:
            self.left_out[found.poses] = str(error)

    def __len__(self) -> int:
        return len(self._rows)

    def _each_once(self, rows: Sequence[Row]) -> list[Row]:
        """The first row of each file: by a second one, a scan could be held out and in the map."""
        first: dict[str, Row] = {}
        for row in rows:
            if first.setdefault(normpath(row[0]), row) is not row:
                self.left_out[row[0]] = "it is listed twice: its first row counts"
        return list(first.values())

    def posed(self) -> Iterator[tuple[str, Matrix]]:
        """Yield the name and T_map_sensor of each scan that has a pose."""
        for name, pose in self._rows:
            try:
                yield name, pose if isinstance(pose, np.ndarray) else pose_of(pose)
            except ValueError as error:
                self.left_out[name] = str(error)

    def read(self, name: str) -> NDArray[np.float32] | None:
        """(n, 3) points of a scan; None: it cannot be read."""
        scan = self.read_scan(name)
        return None if scan is None else scan.points

    def read_scan(self, name: str) -> Scan | None:
        """Read a whole scan; None: it cannot be read."""
        try:
            return read_posed_scan(self._folder, name)
        except ValueError as error:
            self.left_out[name] = str(error)
            return None
