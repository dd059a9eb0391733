"""Matching of clouds that several LiDARs took at about the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from firstfix.recording.clouds import RecordedCloud

WINDOW_S = 0.1  # LiDARs that nobody synchronised turn at 10 Hz: the nearest clouds differ by up to 0.05 s
_PATIENCE_S = 0.5  # of recording: drivers send late, by their load and the network
_MAX_WAITING = 64  # clouds of one topic, should the recording's own clock stand still


@dataclass(frozen=True)
class _Cloud:
    """A cloud that waits for its partners.

    Attributes:
        stamp_ns: by the sensor; by the recorder if the sensor gives none.
    """

    stamp_ns: int
    recorded: RecordedCloud


class CloudSets:
    """Finds for each cloud of the first topic the nearest one of every other topic.

    Stamps count, not the order of recording: drivers send late. A cloud without partners within WINDOW_S is
    left out. Only the clouds of the last half second of recording are in memory.

    Args:
        topics: of the LiDARs, the one that leads first.

    Attributes:
        left_out: number of the first topic's clouds without partners.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.left_out = 0
        self._leading = topics[0]
        self._leaders: deque[_Cloud] = deque()
        self._others: dict[str, deque[_Cloud]] = {topic: deque(maxlen=_MAX_WAITING) for topic in topics[1:]}
        self._nearest_ns: dict[str, int] = {}

    def add(self, recorded: RecordedCloud) -> list[tuple[RecordedCloud, ...]]:
        """Take the next cloud of the recording. Returns the sets that it completes, in the topics' order.

        Raises:
            MalformedData, UnsupportedFormat: it has no valid header.
        """
        cloud = _Cloud(self._stamp_ns(recorded), recorded)
        if recorded.topic == self._leading:
            self._leaders.append(cloud)
        else:
            self._others[recorded.topic].append(cloud)
        found = self._complete(recorded.time_ns, at_end=len(self._leaders) > _MAX_WAITING)
        self._forget(recorded.time_ns)
        return found

    def end(self) -> list[tuple[RecordedCloud, ...]]:
        """The sets that are left at the end of the recording."""
        return self._complete(0, at_end=True)

    def why_left_out(self) -> str:
        """Says how far the nearest clouds were from those that were left out."""
        said = []
        for topic in self._others:
            ns = self._nearest_ns.get(topic)
            said.append(
                f"{topic} had none" if ns is None else f"the nearest of {topic} was {ns / 1e9:.3f} s away"
            )
        return "; ".join(said)

    def _stamp_ns(self, recorded: RecordedCloud) -> int:
        if not self._others:
            return recorded.time_ns  # a cloud that is not used may be damaged
        return recorded.header().stamp.ns or recorded.time_ns

    def _complete(self, now_ns: int, *, at_end: bool) -> list[tuple[RecordedCloud, ...]]:
        found = []
        while self._leaders:
            leader = self._leaders[0]
            waited = now_ns - leader.recorded.time_ns > _PATIENCE_S * 1e9
            partners = [self._partner(leader, waiting) for waiting in self._others.values()]
            if not (at_end or waited or all(is_final for _, is_final in partners)):
                break
            self._leaders.popleft()
            nearest = [cloud.recorded for cloud, _ in partners if cloud is not None]
            if len(nearest) == len(partners):
                found.append((leader.recorded, *nearest))
            else:
                self._leave_out(leader)
        return found

    def _partner(self, leader: _Cloud, waiting: deque[_Cloud]) -> tuple[_Cloud | None, bool]:
        """The nearest cloud in the window, if any, and whether no nearer one is to be expected."""
        nearest = min(waiting, key=lambda cloud: abs(cloud.stamp_ns - leader.stamp_ns), default=None)
        if nearest is None or abs(nearest.stamp_ns - leader.stamp_ns) > WINDOW_S * 1e9:
            return None, False
        is_near = abs(nearest.stamp_ns - leader.stamp_ns) <= WINDOW_S / 2 * 1e9
        return nearest, is_near and any(cloud.stamp_ns >= leader.stamp_ns for cloud in waiting)

    def _leave_out(self, leader: _Cloud) -> None:
        self.left_out += 1
        for topic, waiting in self._others.items():
            apart = [abs(cloud.stamp_ns - leader.stamp_ns) for cloud in waiting]
            if apart:
                self._nearest_ns[topic] = min(apart)

    def _forget(self, now_ns: int) -> None:
        for waiting in self._others.values():
            while waiting and now_ns - waiting[0].recorded.time_ns > 2 * _PATIENCE_S * 1e9:
                waiting.popleft()
