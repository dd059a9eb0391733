"""Stand-ins for the few classes of rclpy and of the message packages that the node touches."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

KINDS = ["DiagnosticArray", "PoseArray", "PoseWithCovarianceStamped", "TFMessage"]
KINDS += ["Imu", "PointCloud2", "Trigger"]


MESSAGES = ("diagnostic_msgs", "geometry_msgs", "sensor_msgs", "tf2_msgs")


class Message:
    """A message with the given attributes."""

    def __init__(self, **values: Any) -> None:
        self.header = SimpleNamespace(stamp=None)
        self.__dict__.update(values)


class Graph:
    """Records what nodes declare. It replaces the middleware."""

    def __init__(self) -> None:
        self.parameters: dict[str, Any] = {}
        self.subscriptions: dict[str, tuple[type, Any, Any]] = {}
        self.published: dict[str, list[Any]] = {}
        self.services: dict[str, Any] = {}
        self.timers: list[Any] = []
        self.log: list[str] = []


def install(monkeypatch: Any, graph: Graph) -> None:
    """Installs the stand-ins as ``rclpy`` and the other ROS modules."""

    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def declare_parameter(self, name: str, value: Any) -> None:
            graph.parameters.setdefault(name, value)

        def get_parameter(self, name: str) -> Any:
            return SimpleNamespace(value=graph.parameters[name])

        def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
            return SimpleNamespace(
                publish=graph.published.setdefault(topic, []).append, get_subscription_count=lambda: 1
            )

        def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any, *, raw: bool) -> None:
            assert raw
            graph.subscriptions[topic] = (kind, callback, qos)

        def create_service(self, kind: type, name: str, callback: Any) -> None:
            graph.services[name] = callback

        def create_timer(self, period_s: float, callback: Any) -> None:
            graph.timers.append(callback)

        def get_namespace(self) -> str:
            return "/robot1"

        def get_logger(self) -> Any:
            def say(text: str, **_: Any) -> None:
                graph.log.append(text)

            return SimpleNamespace(info=say, warning=say)

        def destroy_node(self) -> None:
            graph.log.append("destroyed")

    kinds = {name: type(name, (Message,), {}) for name in KINDS}
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.logging": {"get_logger": lambda name: SimpleNamespace(fatal=graph.log.append)},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="transient local"),
            "QoSProfile": lambda **values: values,
            "qos_profile_sensor_data": "sensor data",
        },
        **{f"{package}.msg": kinds for package in MESSAGES},
        "std_srvs.srv": kinds,
        **{package: {} for package in (*MESSAGES, "std_srvs")},
    }
    for name, values in modules.items():
        module = ModuleType(name)
        module.__dict__.update(values)
        monkeypatch.setitem(sys.modules, name, module)
