"""The first cloud of a recording, for the commands that look at one scan."""

from __future__ import annotations

from pathlib import Path

from firstfix.errors import NotFound
from firstfix.formats.point_cloud import PointCloud
from firstfix.recording.recording import open_recording


def first_cloud(path: Path) -> PointCloud:
    """Read the first cloud of a recording's only topic with clouds.

    Raises:
        NotFound, InputError: as ``open_recording`` and ``Recording.clouds``.
    """
    with open_recording(path) as recording:
        topic = recording.cloud_topic(None)
        for recorded in recording.clouds(topic):
            return recorded.cloud().cloud
        raise NotFound(f"{path}: {topic.name} has no cloud")
