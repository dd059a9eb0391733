"""Mountings of the sensors from tf2_msgs/TFMessage of /tf_static."""

from __future__ import annotations

import itertools

import numpy as np

from ..errors import MalformedData, NotFound
from ..transform import Matrix, inverse
from .tf_message import decode_tf, plain

_SAME_M = 1e-3  # and of a rotation's elements: the last digits of a transform that is sent again


def decode_transforms(body: bytes | memoryview, *, ros1: bool = False) -> dict[str, tuple[str, Matrix]]:
    """Decode a TFMessage to the parent and ``T_parent_child`` of each child frame.

    Raises:
        MalformedData, UnsupportedFormat: see ``decode_tf``.
    """
    return {one.child: (one.parent, one.T_parent_child) for one in decode_tf(body, ros1=ros1)}


class StaticTransforms:
    """The known tree of fixed frames.

    Args:
        strict: a frame that was given twice, and differently, is an error where it is needed: for a
            recording, in which nobody can say which one is right. Otherwise the last one counts, as in tf.
    """

    def __init__(self, *, strict: bool = False) -> None:
        self._strict = strict
        self._parents: dict[str, tuple[str, Matrix]] = {}
        self._disputed: dict[str, str] = {}

    def add(self, transforms: dict[str, tuple[str, Matrix]]) -> None:
        """Add or replaces transforms."""
        for child, (parent, T) in transforms.items():
            known, T_known_child = self._parents.get(child, (parent, T))
            if known != parent or not np.allclose(T, T_known_child, rtol=0, atol=_SAME_M):
                self._disputed[child] = f"{child!r} is mounted in two ways, on {known!r} and on {parent!r}"
            self._parents[child] = parent, T

    def between(self, target: str, source: str) -> Matrix:
        """``T_target_source``.

        Raises:
            NotFound: no chain of fixed frames connects them, or they run in a circle.
            MalformedData: only if strict: a frame of the chain was given twice, and differently.
        """
        target, source = plain(target), plain(source)
        from_target, from_source = self._ancestors(target), self._ancestors(source)
        chains = [*from_target], [*from_source]
        for common, T_common_source in from_source.items():
            if common in from_target:
                self._check_undisputed(*(chain[: chain.index(common)] for chain in chains))
                return inverse(from_target[common]) @ T_common_source
        self._check_undisputed(*chains)
        raise NotFound(
            f"no chain of static transforms connects the frames {target!r} and {source!r}: they hang on "
            f"{chains[0][-1]!r} and {chains[1][-1]!r}"
        )

    def _ancestors(self, frame: str) -> dict[str, Matrix]:
        """``T_ancestor_frame`` of the frame and its ancestors."""
        found = {frame: np.eye(4)}
        T = np.eye(4)
        while frame in self._parents:
            frame, T_parent_child = self._parents[frame]
            if frame in found:  # tf does not allow it, but a file may have it
                circle = " on ".join(map(repr, [*found, frame]))
                raise NotFound(f"the static transforms run in a circle: {circle}")
            T = T_parent_child @ T
            found[frame] = T
        return found

    def _check_undisputed(self, *chains: list[str]) -> None:
        for frame in itertools.chain(*chains):
            if self._strict and frame in self._disputed:
                raise MalformedData(f"the static transforms contradict each other: {self._disputed[frame]}")
