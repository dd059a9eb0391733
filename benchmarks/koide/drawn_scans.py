"""Scans of a recording, drawn at random, with the gravity that its IMU shows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros import imu, point_cloud2
from firstfix.ros.bag import open_bag
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import read_header
from firstfix.ros.imu import GravityWindow, decode_imu
from firstfix.ros.point_cloud2 import StampedCloud, decode_point_cloud2
from firstfix.transform import Matrix

from .layout import CLOUDS, IMU, TruePoses


@dataclass(frozen=True)
class DrawnScan:
    """A cloud of a bag.

    Attributes:
        T_map_sensor: (4, 4) true pose.
        gravity: (3,) unit vector in the sensor frame, pointing down; None: the IMU accelerates, or is absent.
    """

    cloud: StampedCloud
    T_map_sensor: Matrix
    gravity: NDArray[np.float64] | None


def draw_scans(bags: Iterable[Path], true_poses: TruePoses, count: int, seed: int) -> list[DrawnScan]:
    """Draws scans that have a true pose, all with the same chance, in one pass over the bags.

    Returns:
        At most ``count`` scans in the order of time.

    Raises:
        NotFound: a bag has no clouds.
        MalformedData: a bag is damaged.
    """
    rng = np.random.default_rng(seed)
    drawn: list[DrawnScan] = []
    seen = 0
    for path in bags:
        with open_bag(path) as bag:
            bag.check_topic(CLOUDS, point_cloud2.TYPE)
            window = GravityWindow()
            topics = [CLOUDS, *({IMU} & set(bag.topics(imu.TYPE)))]
            for message in bag.messages(topics):
                if message.topic == IMU:
                    window.add(decode_imu(message.body, ros1=bag.ros1))
                    continue
                stamp = read_header(MessageReader("PointCloud2", message.body, ros1=bag.ros1)).stamp
                T_map_sensor = true_poses.at(stamp.ns / 1e9)
                if T_map_sensor is None:
                    continue
                seen += 1
                place = len(drawn) if len(drawn) < count else int(rng.integers(seen))  # Vitter's algorithm R
                if place < count:
                    cloud = decode_point_cloud2(message.body, SCAN_LIMITS, ros1=bag.ros1)
                    drawn[place : place + 1] = [DrawnScan(cloud, T_map_sensor, window.down(stamp))]
    return sorted(drawn, key=lambda scan: scan.cloud.header.stamp)
