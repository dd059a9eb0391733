"""Replay of a recording: each of its clouds, or sets of clouds of several LiDARs, is localized."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TextIO

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption, NotFound
from firstfix.recording.clouds import RecordedCloud, named, where
from firstfix.recording.messages import RawMessage, Topic
from firstfix.recording.recording import Recording, open_recording
from firstfix.ros import imu, tf_message
from firstfix.ros.header import Header
from firstfix.ros.imu import GravityWindow, decode_imu
from firstfix.ros.static_transforms import StaticTransforms
from firstfix.transform import quaternion_of

from ..answerer import Answerer
from .cloud_sets import WINDOW_S, CloudSets
from .merged_scan import merged_scan


@dataclass(frozen=True)
class Replay:
    """Part of a recording that is replayed.

    Attributes:
        topics: topics of the clouds; none: its only one. Clouds of several are merged to one scan in
            the frame, and at the stamp, of the first.
        every: use every n-th cloud, or set of clouds.
        start_s: seconds to skip at the start.
        count: limit on the number of clouds; None: all.
        imu_topic: topic that gives gravity; None: from the scan, or the options.
        base_frame: the robot's base frame, linked to the sensor's by /tf_static; None: from the options.
        tf_static: topic of the fixed frames; None: every one of that name, in any namespace.
    """

    path: Path
    topics: tuple[str, ...] = ()
    every: int = 1
    start_s: float = 0.0
    count: int | None = None
    imu_topic: str | None = None
    base_frame: str | None = None
    tf_static: str | None = None

    @property
    def needs_frames(self) -> bool:
        """Whether the fixed frames are needed."""
        return len(self.topics) > 1 or self.imu_topic is not None or self.base_frame is not None


@dataclass(frozen=True)
class Replayed:
    """One cloud and its answer."""

    header: Header
    answer: Localization


def replay(
    wanted: Replay,
    ask: Answerer,
    options: LocalizeOptions,
    log_line: Callable[[str], None] = lambda line: None,
) -> Iterator[Replayed]:
    """Localize the clouds one after the other, with one in memory; of several LiDARs, those of a second.

    Args:
        log_line: called with a line about how the recording was read, and about clouds, and times of points,
            that were left out.

    Raises:
        InvalidOption: gravity or the mounting is given by both the recording and the options; several topics
            have clouds and none is chosen; or a topic is given twice.
        NotFound: no such file, topic or static transform, no cloud is left, or no cloud has partners.
        MalformedData: the recording or a message in it is damaged, or its static transforms contradict each
            other.
        TooLarge: a compressed message unpacks to more than a cloud may have.
    """
    _check(wanted, options)
    with open_recording(wanted.path) as recording:
        for note in recording.notes:
            log_line(f"{wanted.path}: {note}")
        topics = [recording.cloud_topic(topic) for topic in wanted.topics or (None,)]
        if wanted.imu_topic is not None:
            recording.check_topic(wanted.imu_topic, imu.TYPE)
        if wanted.tf_static is not None:
            recording.check_topic(wanted.tf_static, tf_message.TYPE)
        sets = CloudSets([topic.name for topic in topics])
        number = -1
        answers = _answers(recording, topics, sets, wanted, ask, options, cache(log_line))  # a line once
        for number, replayed in enumerate(answers):  # noqa: B007
            yield replayed
        if sets.left_out:
            left_out = (
                f"{sets.left_out} clouds of {topics[0].name} have no partners within {WINDOW_S:g} s: "
                f"{sets.why_left_out()}"
            )
            if number < 0:
                raise NotFound(f"{wanted.path}: {left_out}")
            log_line(left_out)
        if number < 0:
            raise NotFound(f"{wanted.path}: {topics[0].name} has no cloud after {wanted.start_s:g} s")


def _check(wanted: Replay, options: LocalizeOptions) -> None:
    if wanted.imu_topic is not None and options.gravity is not None:
        raise InvalidOption("give only one of --gravity and --imu-topic")
    if wanted.base_frame is not None and options.T_base_sensor is not None:
        raise InvalidOption("give only one of --T-base-sensor and --base-frame")
    if wanted.every < 1 or wanted.start_s < 0:
        raise InvalidOption("--every must be 1 or more, and --start 0 or more")
    if len(set(wanted.topics)) < len(wanted.topics):
        raise InvalidOption("give each --topic once")
    if wanted.tf_static is not None and not wanted.needs_frames:
        raise InvalidOption("--tf-static needs several --topic, --imu-topic or --base-frame")


def _answers(
    recording: Recording,
    topics: list[Topic],
    sets: CloudSets,
    wanted: Replay,
    ask: Answerer,
    options: LocalizeOptions,
    say: Callable[[str], None],
) -> Iterator[Replayed]:
    frames = _static_transforms(recording, wanted.tf_static) if wanted.needs_frames else StaticTransforms()
    window = GravityWindow()
    for number, found in enumerate(_sets(recording, topics, sets, window, wanted)):
        if number % wanted.every:
            continue
        clouds = [recorded.cloud() for recorded in found]
        for one, cloud in zip(found, clouds, strict=True):
            if cloud.note:
                say(f"{one.topic}: {cloud.note}")
        header = clouds[0].header
        asked = _with_gravity_and_mounting(options, header, window, frames, wanted.base_frame)
        with named(_where(recording, found[0])):
            scan = merged_scan(clouds, frames, say)
        yield Replayed(header, ask(scan, asked))
        if wanted.count is not None and number // wanted.every + 1 >= wanted.count:
            return


def _sets(
    recording: Recording, topics: list[Topic], sets: CloudSets, window: GravityWindow, wanted: Replay
) -> Iterator[tuple[RecordedCloud, ...]]:
    """Yield the clouds that belong together, and give the IMU's messages between them to the window."""
    readers = {(topic.name, topic.type, topic.encoding): recording.cloud_reader(topic) for topic in topics}
    heard = [*(topic.name for topic in topics), *([wanted.imu_topic] if wanted.imu_topic else [])]
    for message in recording.messages(heard, recording.start_ns + round(wanted.start_s * 1e9)):
        if message.topic == wanted.imu_topic:
            with named(_where(recording, message)):
                window.add(decode_imu(message.body, ros1=message.ros1))
        elif (message.topic, message.type, message.encoding) in readers:
            for recorded in readers[message.topic, message.type, message.encoding].add(message):
                yield from sets.add(recorded)
    for reader in readers.values():
        for recorded in reader.end():
            yield from sets.add(recorded)
    yield from sets.end()


def _where(recording: Recording, one: RawMessage | RecordedCloud) -> str:
    return where(str(recording.path), one.topic, one.time_ns)


def _with_gravity_and_mounting(
    options: LocalizeOptions,
    header: Header,
    window: GravityWindow,
    frames: StaticTransforms,
    base_frame: str | None,
) -> LocalizeOptions:
    down = window.down(header.stamp)
    if down is not None:
        same = window.frame_id == header.frame_id
        gravity = down if same else frames.between(header.frame_id, window.frame_id)[:3, :3] @ down
        options = replace(options, gravity=gravity)
    if base_frame is not None:
        options = replace(options, T_base_sensor=frames.between(base_frame, header.frame_id))
    return options


def _static_transforms(recording: Recording, topic: str | None) -> StaticTransforms:
    """The fixed frames of the whole recording: they hold for the clouds before them too."""
    frames = StaticTransforms(strict=True)
    of_name = [t for t in recording.topics_of(tf_message.TYPE) if t.rpartition("/")[2] == "tf_static"]
    for message in recording.messages(of_name if topic is None else [topic]):
        with named(_where(recording, message)):
            for one in tf_message.decode_tf(
                message.body, ros1=message.ros1
            ):  # a message may contradict itself
                frames.add({one.child: (one.parent, one.T_parent_child)})
    return frames


def write_tum(file: TextIO, replayed: Replayed) -> None:
    """Write one line ``stamp x y z qx qy qz qw``: the robot's pose if it is known, else the sensor's."""
    answer = replayed.answer
    T = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    if T is not None:
        numbers = " ".join(f"{v:.9f}" for v in (*T[:3, 3], *quaternion_of(T)))
        file.write(f"{replayed.header.stamp} {numbers}\n")
