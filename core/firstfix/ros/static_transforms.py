"""Mountings of the sensors from tf2_msgs/TFMessage of /tf_static."""

from __future__ import annotations

import numpy as np

from ..errors import NotFound
from ..transform import Matrix, from_quaternion, inverse
from .cdr import MessageReader
from .header import read_header

TYPE = "tf2_msgs/msg/TFMessage"
_MAX_TRANSFORMS = 1000


def decode_transforms(body: bytes | memoryview, *, ros1: bool = False) -> dict[str, tuple[str, Matrix]]:
    """Decodes a TFMessage to the parent and ``T_parent_child`` of each child frame.

    Raises:
        MalformedData: not a TFMessage, or a quaternion of length 0.
        UnsupportedFormat: not plain CDR.
    """
    reader = MessageReader("TFMessage", body, ros1=ros1)
    found: dict[str, tuple[str, Matrix]] = {}
    for _ in range(reader.count(_MAX_TRANSFORMS, "transforms")):
        parent, child = read_header(reader).frame_id, reader.text()
        numbers = reader.floats(7)
        try:
            T = from_quaternion(numbers[:3], numbers[3:])
        except ValueError as error:
            reader.fail(str(error))
        if not np.isfinite(T).all():
            reader.fail("a translation is not finite")
        found[_plain(child)] = (_plain(parent), T)
    reader.end()
    return found


class StaticTransforms:
    """The known tree of fixed frames."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Matrix]] = {}

    def add(self, transforms: dict[str, tuple[str, Matrix]]) -> None:
        """Adds or replaces transforms."""
        self._parents.update(transforms)

    def between(self, target: str, source: str) -> Matrix:
        """Returns ``T_target_source``.

        Raises:
            NotFound: no chain of fixed frames connects them.
        """
        target, source = _plain(target), _plain(source)
        from_target, from_source = self._ancestors(target), self._ancestors(source)
        for common, T_common_source in from_source.items():
            if common in from_target:
                return inverse(from_target[common]) @ T_common_source
        raise NotFound(f"no chain of static transforms connects the frames {target!r} and {source!r}")

    def _ancestors(self, frame: str) -> dict[str, Matrix]:
        """Returns ``T_ancestor_frame`` of the frame and its ancestors."""
        found = {frame: np.eye(4)}
        T = np.eye(4)
        while frame in self._parents:
            frame, T_parent_child = self._parents[frame]
            if frame in found:
                break  # a loop: tf does not allow it, but a file may have one
            T = T_parent_child @ T
            found[frame] = T
        return found


def _plain(frame: str) -> str:
    return frame.removeprefix("/")  # ROS 1 before tf2
