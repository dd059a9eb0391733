"""The tree of frames as a robot publishes it: fixed ones, and moving ones with their last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import takewhile

import numpy as np

from firstfix.ros.header import Stamp
from firstfix.ros.tf_message import StampedTransform, plain
from firstfix.transform import Matrix, from_quaternion, inverse

HISTORY_S = 10.0  # as tf2's buffer
HOLD_S = 0.5  # a transform is valid for so long before its first and after its last sample
MAX_FRAMES = 2000
MAX_SAMPLES = 2000  # of a moving frame: 10 s at 200 Hz


class TransformTree:
    """Latest transforms between frames. Frames beyond ``MAX_FRAMES`` are ignored."""

    def __init__(self) -> None:
        self._fixed: dict[str, StampedTransform] = {}
        self._moving: dict[str, deque[StampedTransform]] = {}

    def add_fixed(self, transforms: Iterable[StampedTransform]) -> None:
        """Add or replaces transforms of /tf_static."""
        for one in transforms:
            if one.child in self._fixed or len(self._fixed) < MAX_FRAMES:
                self._fixed[one.child] = one

    def add_moving(self, transforms: Iterable[StampedTransform]) -> None:
        """Add transforms of /tf and forgets old ones."""
        for one in transforms:
            samples = self._moving.get(one.child)
            if samples is None:
                if len(self._moving) >= MAX_FRAMES:
                    continue
                samples = self._moving[one.child] = deque(maxlen=MAX_SAMPLES)
            if samples and (one.parent != samples[-1].parent or _is_restart(samples[-1], one)):
                samples.clear()
            if not samples or one.stamp > samples[-1].stamp:
                samples.append(one)
            while samples[-1].stamp.ns - samples[0].stamp.ns > HISTORY_S * 1e9:
                samples.popleft()

    def newest_below(self, parent: str) -> StampedTransform | None:
        """The last sample of the frames that move in a frame; None if there is none."""
        name = plain(parent)
        last = [samples[-1] for samples in self._moving.values() if samples and samples[-1].parent == name]
        return max(last, key=lambda one: one.stamp, default=None)

    def stamps_below(self, parent: str, after: Stamp) -> list[Stamp]:
        """The times after a time of the frame that moved last in a frame, oldest first."""
        newest = self.newest_below(parent)
        if newest is None:
            return []
        later = takewhile(lambda one: one.stamp > after, reversed(self._moving[newest.child]))
        return [one.stamp for one in later][::-1]

    def between(self, target: str, source: str, at: Stamp) -> Matrix | None:
        """``T_target_source`` at a time; None if it is not known.

        Args:
            at: zero stands for the last known time.
        """
        target, source = plain(target), plain(source)
        from_target, from_source = self._ancestors(target, at), self._ancestors(source, at)
        for common, T_common_source in from_source.items():
            if common in from_target:
                return inverse(from_target[common]) @ T_common_source
        return None

    def _ancestors(self, frame: str, at: Stamp) -> dict[str, Matrix]:
        """``T_ancestor_frame`` of the frame and of its ancestors."""
        found = {frame: np.eye(4)}
        T = np.eye(4)
        while (link := self._link(frame, at)) is not None:
            frame, T_parent_child = link
            if frame in found:
                break  # a loop, which tf does not allow
            T = T_parent_child @ T
            found[frame] = T
        return found

    def _link(self, child: str, at: Stamp) -> tuple[str, Matrix] | None:
        """The parent of a frame and ``T_parent_child``."""
        if child in self._fixed:
            return self._fixed[child].parent, self._fixed[child].T_parent_child
        samples = self._moving.get(child)
        if not samples:
            return None
        T = _at(samples, at)
        return None if T is None else (samples[-1].parent, T)


def _is_restart(last: StampedTransform, new: StampedTransform) -> bool:
    """Whether the clock was set back, or a bag was started again."""
    return last.stamp.ns - new.stamp.ns > HISTORY_S * 1e9


def _at(samples: deque[StampedTransform], at: Stamp) -> Matrix | None:
    if not at.ns:
        return samples[-1].T_parent_child
    after: StampedTransform | None = None
    for sample in reversed(samples):
        if sample.stamp <= at:
            return _between(sample, after, at)
        after = sample
    assert after is not None
    return after.T_parent_child if after.stamp.ns - at.ns <= HOLD_S * 1e9 else None


def _between(before: StampedTransform, after: StampedTransform | None, at: Stamp) -> Matrix | None:
    """The transform at a time between two samples, by linear interpolation."""
    if after is None:
        return before.T_parent_child if at.ns - before.stamp.ns <= HOLD_S * 1e9 else None
    share = (at.ns - before.stamp.ns) / (after.stamp.ns - before.stamp.ns)
    a, b = np.array(before.numbers), np.array(after.numbers)
    a[3:] /= np.linalg.norm(a[3:])
    b[3:] /= np.linalg.norm(b[3:])
    if a[3:] @ b[3:] < 0:  # the same rotation, by the shorter way
        b[3:] = -b[3:]
    mixed = (1 - share) * a + share * b
    return from_quaternion(mixed[:3], mixed[3:])
