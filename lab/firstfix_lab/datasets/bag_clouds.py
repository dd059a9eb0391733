"""A recording as bags of ROS 1 or 2: the clouds of one topic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import NotFound
from firstfix.recording.clouds import RecordedCloud
from firstfix.recording.recording import open_recording
from firstfix.transform import Matrix

from .ground_truth import GroundTruth
from .recording import RecordedScan, Recording


class BagClouds(Recording):
    """Reads the clouds of a topic, at the stamps of their headers. The bags are read once for the stamps.

    Args:
        topic: None: the only one with clouds.
    """

    def __init__(
        self, bags: Sequence[Path], topic: str | None, truth: GroundTruth, T_body_sensor: Matrix
    ) -> None:
        self._bags = bags
        self._topic = topic
        self.notes = []
        for path in bags:
            with open_recording(path) as recording:
                self.notes += [f"{path}: {note}" for note in recording.notes]
        super().__init__([stamp for stamp, _, _ in self._clouds()], truth, T_body_sensor)

    def read(self, chosen: NDArray[np.intp]) -> Iterator[RecordedScan]:
        """Read these clouds one after the other, see ``Recording``. Bags are read up to the last one."""
        wanted = {int(self.stamps_ns[k]): int(k) for k in chosen}
        for stamp_ns, path, recorded in self._clouds():
            k = wanted.pop(stamp_ns, None)
            if k is None:
                continue
            scan = recorded.cloud().scan()
            yield RecordedScan(f"{path}: {recorded.topic} at {stamp_ns} ns", scan, self.T_map_sensor[k])
            if not wanted:
                return

    def _clouds(self) -> Iterator[tuple[int, Path, RecordedCloud]]:
        for path in self._bags:
            with open_recording(path) as recording:
                for recorded in recording.clouds(recording.cloud_topic(self._topic)):
                    yield recorded.header().stamp.ns, path, recorded


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
