"""The first cloud of each topic of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from firstfix.errors import NotFound
from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import StampedCloud

from ..limited_reader import limited_memory


@dataclass(frozen=True)
class FirstCloud:
    """The first cloud of a topic.

    Attributes:
        stamped: the cloud; None: what reads the topic is missing.
        why: what is missing, and how to get it.
        notes: on the way the recording was read, a sentence each.
    """

    topic: str
    stamped: StampedCloud | None
    why: str
    notes: list[str]


def first_clouds(path: Path) -> Iterator[FirstCloud]:
    """Yield each topic of clouds, with its first one.

    Packets whose metadata or library is missing are named beside clouds that can be read.

    Raises:
        NotFound: no topic has clouds; the error says what is there, or what its only topic needs.
        ModuleNotFoundError: a package that its only topic needs is not installed.
        InputError: another subclass; the recording or a cloud is damaged.
    """
    with limited_memory(), open_recording(path) as recording:
        topics = recording.cloud_topics or [recording.cloud_topic(None)]
        for topic in topics:
            try:
                for recorded in islice(recording.clouds(topic), 1):
                    yield FirstCloud(topic.name, recorded.cloud(), "", recording.notes)
            except (NotFound, ModuleNotFoundError) as error:
                if len(topics) == 1:
                    raise
                yield FirstCloud(topic.name, None, str(error), recording.notes)
