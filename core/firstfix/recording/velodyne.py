"""Velodyne's packets, in velodyne_msgs/VelodyneScan or in a capture (.pcap), decoded by velodyne-decoder."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData, UnsupportedFormat, pip_install
from ..formats.point_cloud import SCAN_LIMITS, Limits, PointCloud
from ..ros.header import Header, Stamp, read_header
from ..ros.point_cloud2 import StampedCloud
from .clouds import Decode
from .confined_process import ConfinedProcess
from .messages import RawMessage
from .struct_reader import StructReader

TYPE = "velodyne_msgs/msg/VelodyneScan"
FRAME = "velodyne"  # of a capture, which names none
_PACKET_BYTES = 1206
_MAX_PACKETS = 10_000
_COLUMNS = ("x", "y", "z", "intensity", "time", "ring")


def velodyne_decoder() -> Decode:
    """Make a decoder of VelodyneScan. The stamp is that of the last packet, and the times count from it.

    Raises:
        ModuleNotFoundError: velodyne-decoder is not installed.
    """
    check_installed()
    process = ConfinedProcess()

    def decode(message: RawMessage, limits: Limits) -> StampedCloud:
        reader = StructReader("VelodyneScan", message.body, ros1=message.ros1)
        header = read_header(reader)
        packet = np.dtype([("sec", "u4"), ("nanosec", "u4"), ("data", f"V{_PACKET_BYTES}")])
        packets = reader.structs(packet, reader.count(_MAX_PACKETS, "packets"))
        reader.end()
        if not len(packets):
            reader.fail("no packets")
        at_s = (packets["sec"] + packets["nanosec"] / 1e9).tolist()
        points = process.run(_points_of, [*zip(at_s, map(bytes, packets["data"]), strict=True)])
        last = Stamp(int(packets["sec"][-1]), int(packets["nanosec"][-1]))
        return StampedCloud(Header(last, header.frame_id), _cloud(points, limits))

    return decode


def _points_of(packets: list[tuple[float, bytes]]) -> NDArray[Any]:
    """Points of one turn's packets, each with the time (s) of its arrival. It runs in a confined process."""
    import velodyne_decoder as library

    given = library.PacketVector()
    for at_s, data in packets:
        given.append(library.VelodynePacket(at_s, data))
    try:
        _, points = _decoder().decode(given, True)
    except Exception as error:  # RuntimeError and others: a model that packets alone do not tell
        raise UnsupportedFormat(f"VelodyneScan: {error}") from error
    return points


@lru_cache
def _decoder() -> Any:
    """The decoder of this process: of a turn's packets it learns the sensor's model."""
    import velodyne_decoder as library

    return library.ScanDecoder(library.Config())


def clouds_of_pcap(path: Path) -> Iterator[StampedCloud]:
    """Yield the turns of a capture's packets, each with its last packet's time of capture.

    It runs in a confined process.

    Raises:
        UnsupportedFormat: of a model that the packets do not tell.
        MalformedData: the capture is damaged.
    """
    import velodyne_decoder as library

    turns = library.read_pcap(str(path), library.Config(), as_pcl_structs=True)
    while True:
        try:
            turn = next(turns, None)
        except ValueError as error:
            raise UnsupportedFormat(f"{error}") from error
        except Exception as error:  # dpkt and the decoder have several
            raise MalformedData(f"{str(error) or type(error).__name__}") from error
        if turn is None:
            return
        stamp, points = turn
        yield StampedCloud(Header(Stamp.of_ns(round(stamp.host * 1e9)), FRAME), _cloud(points, SCAN_LIMITS))


def _cloud(points: NDArray[Any], limits: Limits) -> PointCloud:
    limits.check("velodyne", len(points), points.dtype.itemsize)
    return PointCloud({name: points[name] for name in _COLUMNS})


def check_installed() -> None:
    """Check that the decoder is there.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    if find_spec("velodyne_decoder") is None:
        raise ModuleNotFoundError(
            f"Velodyne's packets need the package velodyne-decoder: {pip_install('.[velodyne]')}",
            name="velodyne_decoder",
        )
