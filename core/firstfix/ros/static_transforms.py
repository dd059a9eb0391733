"""Mountings of the sensors from tf2_msgs/TFMessage of /tf_static."""

from __future__ import annotations

import numpy as np

from ..errors import NotFound
from ..transform import Matrix, inverse
from .tf_message import decode_tf, plain


def decode_transforms(body: bytes | memoryview, *, ros1: bool = False) -> dict[str, tuple[str, Matrix]]:
    """Decodes a TFMessage to the parent and ``T_parent_child`` of each child frame.

    Raises:
        MalformedData, UnsupportedFormat: see ``decode_tf``.
    """
    return {one.child: (one.parent, one.T_parent_child) for one in decode_tf(body, ros1=ros1)}


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
        target, source = plain(target), plain(source)
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
