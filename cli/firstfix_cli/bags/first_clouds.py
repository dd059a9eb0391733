"""The first cloud of each topic of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import StampedCloud

from ..limited_reader import limited_memory


def first_clouds(path: Path) -> Iterator[tuple[str, StampedCloud]]:
    """Yield each topic of clouds, with its first one.

    Raises:
        NotFound: no topic has clouds; the error says what is there.
        InputError: another subclass; the recording or a cloud is damaged.
    """
    with limited_memory(), open_recording(path) as recording:
        for topic in recording.cloud_topics or [recording.cloud_topic(None)]:
            for recorded in islice(recording.clouds(topic), 1):
                yield topic.name, recorded.cloud()
