"""A recording as bags of ROS 1 or 2: the clouds of one topic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InputError, NotFound
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros import point_cloud2
from firstfix.ros.bag import Bag, RawMessage, open_bag
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import read_header
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix.transform import Matrix

from .ground_truth import GroundTruth
from .recording import RecordedScan, Recording


class BagClouds(Recording):
    """Reads the clouds of a topic, at the stamps of their headers. The bags are read once for the stamps."""

    def __init__(self, bags: Sequence[Path], topic: str, truth: GroundTruth, T_body_sensor: Matrix) -> None:
        self._bags = bags
        self._topic = topic
        super().__init__([stamp for stamp, _, _ in self._clouds()], truth, T_body_sensor)

    def read(self, chosen: NDArray[np.intp]) -> Iterator[RecordedScan]:
        """Read these clouds one after the other, see ``Recording``. Bags are read up to the last one."""
        wanted = {int(self.stamps_ns[k]): int(k) for k in chosen}
        for stamp_ns, bag, message in self._clouds():
            k = wanted.pop(stamp_ns, None)
            if k is None:
                continue
            name = f"{bag.path}: {self._topic} at {stamp_ns} ns"
            try:
                scan = decode_point_cloud2(message.body, SCAN_LIMITS, ros1=bag.ros1).scan()
            except InputError as error:
                raise type(error)(f"{name}: {error}") from error
            yield RecordedScan(name, scan, self.T_map_sensor[k])
            if not wanted:
                return

    def _clouds(self) -> Iterator[tuple[int, Bag, RawMessage]]:
        for path in self._bags:
            with open_bag(path) as bag:
                bag.check_topic(self._topic, point_cloud2.TYPE)
                for message in bag.messages([self._topic]):
                    try:
                        header = read_header(MessageReader("PointCloud2", message.body, ros1=bag.ros1))
                    except InputError as error:
                        raise type(error)(f"{path}: {self._topic}: {error}") from error
                    yield header.stamp.ns, bag, message


def bags_in(path: Path) -> list[Path]:
    """The bags of a folder in the order of their names, or the one bag itself.

    Raises:
        NotFound: there is none.
    """
    if path.is_file():
        return [path]
    bags = sorted(each for each in path.glob("*") if each.suffix in (".bag", ".mcap", ".db3"))
    if not bags:
        raise NotFound(f"{path}: no bag (*.bag, *.mcap, *.db3)")
    return bags
