"""A capture of a LiDAR's packets (.pcap) or an .osf file: a library makes clouds of it, one for each turn.

The library runs in a confined process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from ..errors import MalformedData
from ..ros.point_cloud2 import StampedCloud
from . import ouster, velodyne
from .confined_process import ConfinedProcess
from .messages import RawMessage, Topic
from .pcap_kind import VELODYNE, kind_of
from .time_order import Part, in_time_order
from .whole_turns import whole_turns

ENDINGS = (".pcap", ".osf", ".pcapng")  # the last one is named with what makes a plain one of it
TYPE, ENCODING = "firstfix.CapturedTurn", "capture"


@dataclass(frozen=True, slots=True)
class CapturedTurn(RawMessage):
    """A turn that a library has decoded.

    Attributes:
        cloud: its points.
    """

    cloud: StampedCloud


class CaptureFile:
    """See ``Storage``. Its topics are those of the makers' drivers: a capture has none."""

    def __init__(self, path: Path) -> None:
        self.notes: list[str] = []
        self._process = ConfinedProcess()
        try:
            self._read = _topics(path, self._process)
            self._look_at_firsts()
        except BaseException:
            self._process.close()
            raise

    def _look_at_firsts(self) -> None:
        firsts = [cloud for read in self._read.values() for cloud in islice(read(), 1)]
        if not firsts:
            raise MalformedData("it holds no turn of a LiDAR")
        self.start_ns = min(cloud.header.stamp.ns for cloud in firsts)
        self.topics = [Topic(name, TYPE, ENCODING, None) for name in self._read]

    def messages(self, topics: Set[str], start_ns: int | None) -> Iterator[RawMessage]:
        """Yield the turns of these topics in the order of recording, from a time on."""
        parts = [
            Part(self.start_ns, partial(self._turns, name, start_ns or 0))
            for name in sorted(topics & set(self._read))
        ]
        return (turn for _, turn in in_time_order(parts))

    def _turns(self, name: str, start_ns: int) -> Iterator[tuple[int, RawMessage]]:
        for cloud in self._read[name]():
            time_ns = cloud.header.stamp.ns
            if time_ns >= start_ns:
                yield time_ns, CapturedTurn(name, time_ns, b"", TYPE, ENCODING, cloud)

    def close(self) -> None:
        """End the library's process."""
        self._process.close()


def _topics(path: Path, process: ConfinedProcess) -> dict[str, Callable[[], Iterator[StampedCloud]]]:
    """The topics, and what yields the whole turns of each."""
    if path.suffix.lower() != ".osf" and kind_of(path) == VELODYNE:
        velodyne.check_installed()
        return {"/velodyne_points": lambda: whole_turns(process.talk(velodyne.clouds_of_pcap, path))}
    file = ouster.OusterFile(path, process)
    return {
        "/ouster/points" if file.sensors == 1 else f"/ouster{number}/points": partial(
            lambda sensor: whole_turns(file.turns(sensor)), number
        )
        for number in range(file.sensors)
    }
