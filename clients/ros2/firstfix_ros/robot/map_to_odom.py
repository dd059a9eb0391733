"""The transform from the map's frame to the odometry's, after a fix."""

from __future__ import annotations

import threading

from firstfix.ros.header import Header, Stamp
from firstfix.ros.tf_message import StampedTransform, decode_tf, encode_tf
from firstfix.transform import Matrix, inverse

from .config import GatewayConfig
from .query import Fix
from .senses import Senses

AHEAD_S = 0.2  # so long after the last odometry the transform is valid: until the next message


class MapToOdom:
    """``map_frame`` -> ``odom_frame`` of the last wanted fix. Silent once somebody else publishes it."""

    def __init__(self, config: GatewayConfig, senses: Senses) -> None:
        self._config, self._senses = config, senses
        self._lock = threading.Lock()
        self._T_map_odom: Matrix | None = None
        self._missing = ""

    @property
    def missing(self) -> str:
        """The frames without which there is no transform to publish; empty: it needs no others."""
        with self._lock:
            return self._missing

    @property
    def is_known(self) -> bool:
        """True while there is a transform to publish."""
        with self._lock:
            return self._T_map_odom is not None

    def set(self, fix: Fix) -> None:
        """Take a new fix."""
        with self._lock:
            is_missing = self._config.publishes_tf and fix.T_odom_frame is None
            self._missing = f"{self._config.odom_frame} -> {fix.frame}" if is_missing else ""
            if not self._config.publishes_tf or fix.T_odom_frame is None:
                self._T_map_odom = None
            else:
                self._T_map_odom = fix.T_map_frame @ inverse(fix.T_odom_frame)

    def message(self) -> bytes | None:
        """A TFMessage stamped shortly after the last odometry; None if nothing is to be published."""
        stamp = self._senses.odometry_stamp()
        with self._lock:
            if self._senses.others_publish_map:
                self._T_map_odom = None
            if self._T_map_odom is None or stamp is None:
                return None
            header = Header(Stamp.of_ns(stamp.ns + int(AHEAD_S * 1e9)), self._config.map_frame)
            body = encode_tf([(header, self._config.odom_frame, self._T_map_odom)])
        sent: StampedTransform = decode_tf(body)[0]
        self._senses.remember_published(sent)
        return body
