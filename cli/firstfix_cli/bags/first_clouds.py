"""The first clouds of a recording, for those who look at what it has."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import StampedCloud

from ..limited_reader import limited_memory


def first_clouds(
    path: Path, *, of_one_lidar: bool = False, count: int = 1
) -> Iterator[tuple[str, StampedCloud]]:
    """Yield each topic of clouds with its first clouds.

    Args:
        of_one_lidar: only the recording's one topic.
        count: of clouds of a topic.

    Raises:
        NotFound: no topic has clouds; the error says what is there.
        InvalidOption: several have, and one is asked for.
        InputError: another subclass; the recording or a cloud is damaged.
    """
    with limited_memory(), open_recording(path) as recording:
        topics = [] if of_one_lidar else recording.cloud_topics
        for topic in topics or [recording.cloud_topic(None)]:
            for recorded in islice(recording.clouds(topic), count):
                yield topic.name, recorded.cloud()
