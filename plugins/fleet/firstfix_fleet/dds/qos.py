"""Quality of service as ROS 2 sets it, by its names for the profiles."""

from __future__ import annotations

from cyclonedds.core import Policy, Qos
from cyclonedds.util import duration

from firstfix.ros.type_hashes import TYPE_HASHES

_RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=100))  # a writer waits no longer for a reader


def sensor_data(depth: int) -> Qos:
    """Best effort: hears every publisher, and what is lost is lost."""
    return Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(depth))


def reliable(depth: int) -> Qos:
    """Reliable, volatile: what is lost is sent again. A best-effort publisher is not heard."""
    return Qos(_RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(depth))


def latched(depth: int) -> Qos:
    """Reliable and transient local: earlier messages come first, as for /tf_static."""
    return Qos(_RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(depth))


def with_type_hash(qos: Qos, ros_type: str) -> Qos:
    """The quality of service of an endpoint, with its type's hash, if known, where ROS 2 looks for it."""
    known = TYPE_HASHES.get(ros_type)
    return qos if known is None else Qos(Policy.Userdata(f"typehash={known};".encode()), base=qos)


def is_reliable(qos: Qos) -> bool:
    """Whether a publisher offers reliable delivery."""
    return isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
