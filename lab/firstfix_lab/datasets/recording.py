"""A recording of a data set: its scans in the order of time, each with its true pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InvalidOption, NotFound
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .ground_truth import GroundTruth


@dataclass(frozen=True)
class RecordedScan:
    """One scan that was read, and its true pose.

    Attributes:
        name: file, or topic and time.
        scan: points in the sensor frame, as recorded: the robot's motion during the scan is not taken out.
        T_map_sensor: (4, 4) true pose, in the frame of the data set's ground truth.
    """

    name: str
    scan: Scan
    T_map_sensor: Matrix


class Recording(ABC):
    """Scans of one sensor with ground truth.

    Attributes:
        stamps_ns: (n,) int64, times of the scans that have a true pose, ascending.
        T_map_sensor: (n, 4, 4), their poses.
        without_pose: number of scans without one.
        notes: what a user should know of the way it was read, a sentence each.
    """

    notes: Sequence[str] = ()

    def __init__(self, stamps_ns: Sequence[int], truth: GroundTruth, T_body_sensor: Matrix) -> None:
        poses = [(stamp, truth.at(stamp)) for stamp in sorted(stamps_ns)]
        known = [(stamp, pose) for stamp, pose in poses if pose is not None]
        if not known:
            raise NotFound(f"none of the {len(poses)} scans has a true pose at its time")
        self.stamps_ns = np.array([stamp for stamp, _ in known], np.int64)
        self.T_map_sensor: NDArray[np.float64] = np.array([pose @ T_body_sensor for _, pose in known])
        self.without_pose = len(poses) - len(known)

    @abstractmethod
    def read(self, chosen: NDArray[np.intp]) -> Iterator[RecordedScan]:
        """Read these scans (indices in ascending order) one after the other.

        Raises:
            InputError: a subclass; a scan is damaged, the message names it.
        """


def one_a_place(T_map_sensor: NDArray[np.float64], spacing_m: float, seed: int) -> NDArray[np.intp]:
    """Choose one scan by chance from each cell of a grid on the ground: each place counts once.

    Args:
        T_map_sensor: (n, 4, 4) poses.
        spacing_m: edge of a cell, over 0.
        seed: of the choice.

    Returns:
        Indices in ascending order.

    Raises:
        InvalidOption: the spacing is no positive number.
    """
    if not 0 < spacing_m < np.inf:
        raise InvalidOption(f"the distance between places must be over 0 m, not {spacing_m:g}")
    cells = np.floor(T_map_sensor[:, :2, 3] / spacing_m).astype(np.int64)
    order = np.random.default_rng(seed).permutation(len(cells))
    _, first = np.unique(cells[order], axis=0, return_index=True)
    return np.sort(order[first])
