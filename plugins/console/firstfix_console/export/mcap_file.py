"""An MCAP file with ROS 2 messages: Foxglove, RViz and ``ros2 bag`` read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Verdict
from firstfix.transform import Matrix, quaternion_of

from .exported_query import MAP_FRAME, ExportedQuery
from .map_cloud import MapCloud

_DEBUG, _INFO, _WARN = 10, 20, 30  # rcl_interfaces/Log
_LEVELS = {Verdict.LOCALIZED: _INFO, Verdict.AMBIGUOUS: _WARN, Verdict.REJECTED: _WARN}
_FLOAT32 = 7  # sensor_msgs/PointField
TOPICS = {
    "/map": "sensor_msgs/msg/PointCloud2",
    "/templates": "sensor_msgs/msg/PointCloud2",
    "/trajectory": "nav_msgs/msg/Path",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/scan": "sensor_msgs/msg/PointCloud2",
    "/scan_not_localized": "sensor_msgs/msg/PointCloud2",
    "/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/hypotheses": "geometry_msgs/msg/PoseArray",
    "/truth": "geometry_msgs/msg/PoseStamped",
    "/probability": "std_msgs/msg/Float64",
    "/answer": "diagnostic_msgs/msg/DiagnosticArray",
    "/log": "rcl_interfaces/msg/Log",
}
LATCHED = ("/map", "/templates", "/trajectory")  # once: who comes later gets them too


class McapFile:
    """Writes messages as they come; the queries may come in any order of time."""

    def __init__(self, writer: Any, types: Any) -> None:
        self._writer, self._store, self._types = writer, types, types.types
        self._connections = {
            topic: writer.add_connection(
                topic, kind, typestore=types, offered_qos_profiles=_qos(topic in LATCHED)
            )
            for topic, kind in TOPICS.items()
        }

    def write_map(self, cloud: MapCloud, time_ns: int) -> None:
        """Write the map's points, the templates and the mapping run at the beginning of the queries."""
        self._write("/map", time_ns, self._cloud(cloud.points, MAP_FRAME, time_ns, cloud.intensity()))
        self._write("/templates", time_ns, self._cloud(cloud.templates, MAP_FRAME, time_ns))
        header = self._header(MAP_FRAME, time_ns)
        unturned = self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        poses = [
            self._make(
                "geometry_msgs/msg/PoseStamped",
                header=header,
                pose=self._make("geometry_msgs/msg/Pose", position=self._point(at), orientation=unturned),
            )
            for at in cloud.trajectory
        ]
        self._write("/trajectory", time_ns, self._make(TOPICS["/trajectory"], header=header, poses=poses))

    def write_query(self, query: ExportedQuery) -> None:
        """Write one query with its answer."""
        at = query.time_ns
        if query.T_map_frame is not None:
            self._write("/tf", at, self._transform(query.T_map_frame, query.frame, at))
        if len(query.points):
            topic = "/scan" if query.localized else "/scan_not_localized"
            self._write(topic, at, self._cloud(query.points, query.frame, at))
        header = self._header(MAP_FRAME, at)
        if query.localized and query.T_map_frame is not None:
            covariance = np.zeros(36) if query.answer.covariance is None else query.answer.covariance.ravel()
            posed = self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._pose(query.T_map_frame),
                covariance=covariance,
            )
            self._write("/pose", at, self._make(TOPICS["/pose"], header=header, pose=posed))
        poses = [self._pose(T) for T in query.hypotheses]
        self._write("/hypotheses", at, self._make(TOPICS["/hypotheses"], header=header, poses=poses))
        if query.T_map_truth is not None:
            truth = self._make(TOPICS["/truth"], header=header, pose=self._pose(query.T_map_truth))
            self._write("/truth", at, truth)
        self._write("/probability", at, self._make(TOPICS["/probability"], data=query.answer.probability))
        self._write("/answer", at, self._diagnostics(query))
        self._write("/log", at, self._log(query))

    def _write(self, topic: str, time_ns: int, message: Any) -> None:
        data = self._store.serialize_cdr(message, TOPICS[topic])
        self._writer.write(self._connections[topic], time_ns, data)

    def _make(self, kind: str, **values: Any) -> Any:
        return self._types[kind](**values)

    def _stamp(self, time_ns: int) -> Any:
        sec, nanosec = divmod(time_ns, 10**9)
        return self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _header(self, frame: str, time_ns: int) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._stamp(time_ns), frame_id=frame)

    def _point(self, at: Iterable[float]) -> Any:
        x, y, z = (float(v) for v in at)
        return self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def _turn(self, T: Matrix) -> Any:
        x, y, z, w = (float(v) for v in quaternion_of(T))
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, T: Matrix) -> Any:
        return self._make("geometry_msgs/msg/Pose", position=self._point(T[:3, 3]), orientation=self._turn(T))

    def _transform(self, T: Matrix, frame: str, time_ns: int) -> Any:
        x, y, z = (float(v) for v in T[:3, 3])
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(MAP_FRAME, time_ns),
            child_frame_id=frame,
            transform=self._make(
                "geometry_msgs/msg/Transform",
                translation=self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=self._turn(T),
            ),
        )
        return self._make(TOPICS["/tf"], transforms=[stamped])

    def _cloud(
        self,
        points: NDArray[np.float32],
        frame: str,
        time_ns: int,
        intensity: NDArray[np.float32] | None = None,
    ) -> Any:
        names = ["x", "y", "z"] if intensity is None else ["x", "y", "z", "intensity"]
        rows = points if intensity is None else np.column_stack([points, intensity])
        step = 4 * len(names)
        return self._make(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(frame, time_ns),
            height=1,
            width=len(points),
            fields=[
                self._make(
                    "sensor_msgs/msg/PointField", name=name, offset=4 * place, datatype=_FLOAT32, count=1
                )
                for place, name in enumerate(names)
            ],
            is_bigendian=False,
            point_step=step,
            row_step=step * len(points),
            data=np.ascontiguousarray(rows, "<f4").reshape(-1).view(np.uint8),
            is_dense=True,
        )

    def _diagnostics(self, query: ExportedQuery) -> Any:
        level = 0 if query.localized else 1
        status = self._make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level,
            name="firstfix",
            message=query.words,
            hardware_id="",
            values=[
                self._make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in facts_of(query)
            ],
        )
        return self._make(TOPICS["/answer"], header=self._header("", query.time_ns), status=[status])

    def _log(self, query: ExportedQuery) -> Any:
        return self._make(
            TOPICS["/log"],
            stamp=self._stamp(query.time_ns),
            level=_LEVELS[query.answer.verdict],
            name="firstfix",
            msg=query.words,
            file="",
            function="",
            line=0,
        )


def facts_of(query: ExportedQuery) -> list[tuple[str, str]]:
    """Facts of an answer, as names and values."""
    answer, recorded = query.answer, query.recorded
    options = [(f"option {name}", value) for name, value in sorted(recorded.options.items())]
    return [
        ("query", recorded.query_id),
        ("verdict", answer.verdict.value),
        ("reasons", ", ".join(reason.value for reason in answer.reasons)),
        ("probability", f"{answer.probability:.6g}"),
        ("hypotheses", str(len(answer.hypotheses))),
        ("map", answer.map_id),
        ("version", answer.map_version),
        ("answered", recorded.time),
        ("transport", recorded.transport),
        ("request", recorded.request_id),
        *options,
    ]


@contextmanager
def mcap_file(folder: Path) -> Iterator[McapFile]:
    """Give a file to write to, which is ``folder / "out"`` at the end.

    Raises:
        ModuleNotFoundError: rosbags is not installed.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    bag = Writer(folder / "bag", version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag as writer:
        yield McapFile(writer, get_typestore(Stores.ROS2_HUMBLE))
    (folder / "bag" / "bag.mcap").rename(folder / "out")


def _qos(latched: bool) -> list[Any]:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(2147483647, 4294967295)
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return [
        Qos(
            QosHistory.KEEP_LAST,
            10,
            QosReliability.RELIABLE,
            durability,
            never,
            never,
            QosLiveliness.AUTOMATIC,
            never,
            False,
        )
    ]
