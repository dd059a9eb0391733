"""Scans that a map was made from, with their poses.

A map's folder brings them in a folder of their own. Without a map file beside it, they are the map
(``map_of_scans.py``).

    mapping_scans/poses.csv    columns scan (path from this folder) and tx,ty,tz,qx,qy,qz,qw (T_map_sensor)
    mapping_scans/...          the scans, as ``firstfix localize`` reads them

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

from .file_errors import naming
from .posed_scans import POSES, pose_of, read_posed_scan, read_poses, why_not_read

FOLDER = "mapping_scans"


class MappingScans:
    """The scans of a map's folder, of which one is in memory at a time.

    Args:
        without: names of scans that do not count.

    Attributes:
        left_out: the reason for each scan, by its name, or for the file of poses.
    """

    def __init__(self, source: Path, axis: str, scale: float = 1.0, *, without: Collection[str] = ()) -> None:
        self.left_out: dict[str, str] = {}
        self._folder = source / FOLDER
        self._rows: list[tuple[str, list[str]]] = []
        if not self._folder.is_dir():
            return
        reason = why_not_read(axis, scale)
        if reason is not None:
            self.left_out[FOLDER] = reason
            return
        try:
            with naming(self._folder / POSES):
                rows = self._each_once(read_poses(self._folder / POSES))
            self._rows = [row for row in rows if row[0] not in without]
        except (InputError, NotFound) as error:
            self.left_out[POSES] = str(error)

    def __len__(self) -> int:
        return len(self._rows)

    def _each_once(self, rows: Sequence[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
        """The first row of each file: by a second one, a scan could be held out and in the map."""
        first: dict[str, tuple[str, list[str]]] = {}
        for row in rows:
            if first.setdefault(normpath(row[0]), row) is not row:
                self.left_out[row[0]] = "it is listed twice: its first row counts"
        return list(first.values())

    def posed(self) -> Iterator[tuple[str, Matrix]]:
        """Yield the name and T_map_sensor of each scan that has a pose."""
        for name, words in self._rows:
            try:
                yield name, pose_of(words)
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
