"""True poses of a recording, interpolated at the times of its scans."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from firstfix.errors import MalformedData, NotFound, TooLarge
from firstfix.formats.text_table import parse_rows
from firstfix.transform import Matrix, make_transform
from firstfix_builder.sources.read_map.file_errors import naming
from firstfix_builder.sources.read_map.rigid import rigid_from_quaternions

NS = 1_000_000_000
MAX_FILE_BYTES = 1_000_000_000
MAX_GAP_NS = 300_000_000  # between two poses: a car turns by some degrees in this time
NEAREST_NS = 20_000_000  # a pose this close is taken where there are no two to interpolate


@dataclass(frozen=True)
class GroundTruth:
    """Poses of a rigid body over time.

    Attributes:
        stamps_ns: (n,) int64, ascending and different.
        T_world_body: (n, 4, 4).
    """

    stamps_ns: NDArray[np.int64]
    T_world_body: NDArray[np.float64]

    def at(self, stamp_ns: int) -> Matrix | None:
        """The pose (4, 4) at a time: interpolated, the nearest within 20 ms, or None.

        Poses that are over 0.3 s apart are not interpolated.
        """
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if 0 < after < len(self.stamps_ns):
            begin, end = (int(self.stamps_ns[k]) for k in (after - 1, after))
            if end - begin <= MAX_GAP_NS:
                share = (stamp_ns - begin) / (end - begin)
                return _between(self.T_world_body[after - 1], self.T_world_body[after], share)
        nearest = min((after - 1, after), key=lambda k: self._off_ns(k, stamp_ns))
        if self._off_ns(nearest, stamp_ns) > NEAREST_NS:
            return None
        pose: Matrix = self.T_world_body[nearest]
        return pose

    def _off_ns(self, k: int, stamp_ns: int) -> float:
        return abs(int(self.stamps_ns[k]) - stamp_ns) if 0 <= k < len(self.stamps_ns) else np.inf

    @classmethod
    def of(cls, path: Path, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]) -> GroundTruth:
        """Sort the poses of a file by time. Of poses with one time, the first one counts.

        Raises:
            MalformedData: there is no pose.
        """
        if not len(stamps_ns):
            raise MalformedData(f"{path}: no row has a pose")
        stamps, first = np.unique(stamps_ns, return_index=True)
        return cls(stamps, poses[first])


def read_rows(path: Path, columns: int, *, delimiter: str | None) -> NDArray[np.float64]:
    """Read rows of numbers, (n, columns) float64. Lines that begin with ``#`` are left out.

    A time in nanoseconds since 1970 is exact to 0.3 us so, in which nothing moves.

    Raises:
        NotFound: no such file.
        TooLarge: over 1 GB.
        MalformedData: not such rows; the message names the file.
    """
    rows = parse_rows(str(path), _content(path), delimiter=delimiter, comments="#")
    if rows.shape[1] != columns:
        raise MalformedData(f"{path}: rows of {rows.shape[1]} numbers, not of {columns}")
    return rows


def read_tum(path: Path) -> GroundTruth:
    """Read rows of seconds x y z qx qy qz qw, separated by spaces.

    Raises:
        NotFound: no such file.
        TooLarge, MalformedData: as ``read_rows``, or a row that is no pose.
    """
    rows = read_rows(path, 8, delimiter=None)
    with naming(path):
        poses = rigid_from_quaternions(rows[:, 1:4], rows[:, 4:])
        check_stamps(rows[:, 0] * NS)
    return GroundTruth.of(path, np.rint(rows[:, 0] * NS).astype(np.int64), poses)


def check_stamps(stamps_ns: NDArray[np.float64]) -> None:
    """Refuse times that no clock gives, before they become integers.

    Raises:
        MalformedData: one is not finite, negative or too large.
    """
    bad = ~((stamps_ns >= 0) & (stamps_ns < 2**62))
    if bad.any():
        raise MalformedData(f"poses: pose {int(np.argmax(bad)) + 1} has no time")


def _content(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise TooLarge(f"{path}: {size} bytes, the limit is {MAX_FILE_BYTES}")
        return path.read_bytes()
    except (FileNotFoundError, IsADirectoryError):
        raise NotFound(f"{path}: no such file") from None


def _between(T_begin: Matrix, T_end: Matrix, share: float) -> Matrix:
    """Interpolates two poses: the translation linearly, the rotation along the shortest turn."""
    ends = Rotation.from_matrix(np.array([T_begin[:3, :3], T_end[:3, :3]]))
    rotation = Slerp([0.0, 1.0], ends)(share).as_matrix()
    return make_transform(rotation, (1 - share) * T_begin[:3, 3] + share * T_end[:3, 3])
