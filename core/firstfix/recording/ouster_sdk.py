"""Clouds that ouster-sdk makes of packets and files. It runs in a confined process.

A cloud is in the sensor's frame: the LiDAR's own, which the beams are given in, is turned by 180 degrees and
lies 36 mm higher. Each column of the picture has its time. Pixels without a return are left out: the SDK puts
them in the origin.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FirstfixError, MalformedData, NotFound
from ..formats.point_cloud import SCAN_LIMITS, PointCloud
from ..ros.header import Header, Stamp
from ..ros.point_cloud2 import StampedCloud

FRAME = "os_sensor"  # as its driver names it
_MAX_METADATA_BYTES = 1_000_000
_MAX_COLUMNS, _MAX_PIXELS = 8192, 1024  # four times those of any sensor
_PER_PACKET = re.compile(r'"columns_per_packet"\s*:\s*(\d+)')


def turns_of_packets(metadata: str) -> Generator[Any, tuple[bytes, int] | None, None]:
    """Yield the bytes of a packet; then for each packet that is sent the turn that was complete before it.

    What is sent is a packet with the time (ns) of its arrival, or None for the turn that was begun. What
    comes is a StampedCloud, None, or MalformedData for a packet that the SDK refuses.

    Args:
        metadata: of the sensor, as JSON.

    Raises:
        MalformedData: the metadata is not of an Ouster.
    """
    import ouster.sdk.core as sdk

    _check_divisor("the sensor's metadata", metadata)
    with _of_sdk("the sensor's metadata"):
        info = sdk.SensorInfo(metadata)
        _check_size(info)
        form = sdk.PacketFormat(info)
        batcher, frame, cloud_of = sdk.FrameBatcher(info), sdk.LidarFrame(info), frame_decoder(info)
    sent = yield form.lidar_packet_size
    while True:
        answer: StampedCloud | MalformedData | None = None
        try:
            with _of_sdk("a packet"):
                if sent is None or _is_next_turn(sdk, form, batcher, frame, sent):
                    done, frame = frame, sdk.LidarFrame(info)
                    answer = cloud_of(done)
        except MalformedData as error:
            answer = error
        sent = yield answer


def _is_next_turn(sdk: Any, form: Any, batcher: Any, frame: Any, sent: tuple[bytes, int]) -> bool:
    """Put a packet into a frame. Returns whether it is of the next turn."""
    data, time_ns = sent
    packet = sdk.LidarPacket(form)
    packet.buf[:] = np.frombuffer(data, np.uint8)
    packet.host_timestamp = time_ns
    return bool(batcher.batch(packet, frame))


def clouds_of_file(path: Path, sensor: int) -> Iterator[StampedCloud]:
    """Yield the turns of one sensor of a capture or an .osf file.

    Raises:
        MalformedData: damaged.
    """
    with _of_sdk(path.name):
        source = _opened(path)
        cloud_of = frame_decoder(source.sensor_info[sensor])
        for frames in source:
            frame = frames[sensor]
            cloud = None if frame is None else cloud_of(frame)
            if cloud is not None:
                yield cloud


def sensors_of_file(path: Path) -> int:
    """The number of sensors in a capture or an .osf file.

    Raises:
        NotFound: no metadata of the sensor beside a capture.
        MalformedData: damaged.
    """
    with _of_sdk(path.name):
        return len(_opened(path).sensor_info)


def _check_size(info: Any) -> None:
    """Check the picture's size before the SDK makes room for it."""
    columns, pixels = info.format.columns_per_frame, info.format.pixels_per_column
    if not (0 < columns <= _MAX_COLUMNS and 0 < pixels <= _MAX_PIXELS):
        raise MalformedData(f"the sensor's metadata: a picture of {columns} columns of {pixels} pixels")


def _check_beside(capture: Path) -> None:
    """Check the metadata beside a capture for what ends the SDK's process: it divides by this number."""
    for beside in capture.parent.glob("*.json"):
        if beside.stat().st_size > _MAX_METADATA_BYTES or beside.name[0] != capture.name[0]:
            continue
        _check_divisor(beside.name, beside.read_text(errors="replace"))


def _check_divisor(name: str, metadata: str) -> None:
    for digits in _PER_PACKET.findall(metadata):
        if int(digits) == 0:
            raise MalformedData(f"{name}: columns_per_packet is 0")


def _opened(path: Path) -> Any:
    _check_beside(path)
    from ouster.sdk.open_source import open_source

    try:
        source = open_source(str(path), collate=True)
    except Exception as error:
        if "metadata" not in str(error).lower() or path.suffix == ".osf":
            raise
        raise NotFound(
            f"{path}: no metadata of its sensor. Put the JSON file that the sensor gives (http://SENSOR/api/v1/sensor/"
            f"metadata) beside it, with the same beginning of its name: {path.stem}.json"
        ) from error
    for info in source.sensor_info:
        _check_size(info)
    return source


def frame_decoder(info: Any) -> Callable[[Any], StampedCloud | None]:
    """Make the function that turns a sensor's LidarFrame into a cloud; None: it has no point."""
    import ouster.sdk.core as sdk

    place = sdk.XYZLut(info, use_extrinsics=False)
    rings = np.arange(info.format.pixels_per_column, dtype=np.uint16)

    def cloud(frame: Any) -> StampedCloud | None:
        ranges = frame.field("RANGE")
        times_ns = frame.timestamp.astype(np.int64)
        taken = (ranges > 0) & ((frame.status & 1) > 0)[None, :]
        if not taken.any():
            return None
        SCAN_LIMITS.check("ouster", int(taken.sum()), 24)
        first_ns = int(times_ns[taken.any(axis=0)].min())
        xyz = place(ranges)[taken]
        columns = {axis: xyz[:, number].astype(np.float32) for number, axis in enumerate("xyz")}
        for name in ("REFLECTIVITY", "SIGNAL"):
            if frame.has_field(name):
                columns["intensity"] = frame.field(name)[taken]
                break
        columns["t"] = np.broadcast_to((times_ns - first_ns).astype(np.uint32)[None, :], taken.shape)[taken]
        columns["ring"] = np.broadcast_to(rings[:, None], taken.shape)[taken]
        return StampedCloud(Header(Stamp.of_ns(first_ns), FRAME), PointCloud(columns))

    return cloud


@contextmanager
def _of_sdk(what: str) -> Iterator[None]:
    """Turn the exceptions of the SDK, of which it has many, into MalformedData."""
    try:
        yield
    except (FirstfixError, ModuleNotFoundError):
        raise
    except Exception as error:
        raise MalformedData(f"{what}: {str(error) or type(error).__name__}") from error
