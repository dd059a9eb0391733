"""Replay of a bag: each of its clouds is localized."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption, MalformedData, NotFound
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros import imu, tf_message
from firstfix.ros.bag import Bag, RawMessage, open_bag
from firstfix.ros.header import Header
from firstfix.ros.imu import GravityWindow, decode_imu
from firstfix.ros.point_cloud2 import StampedCloud, decode_point_cloud2
from firstfix.ros.static_transforms import StaticTransforms, decode_transforms
from firstfix.transform import quaternion_of

from .answerer import Answerer


@dataclass(frozen=True)
class Replay:
    """Part of a bag that is replayed.

    Attributes:
        topic: topic of the clouds; None: the bag's only one.
        every: use every n-th cloud.
        start_s: seconds to skip at the start.
        count: limit on the number of clouds; None: all.
        imu_topic: topic that gives gravity; None: from the scan, or the options.
        base_frame: the robot's base frame, linked to the sensor's by /tf_static; None: from the options.
    """

    path: Path
    topic: str | None = None
    every: int = 1
    start_s: float = 0.0
    count: int | None = None
    imu_topic: str | None = None
    base_frame: str | None = None


@dataclass(frozen=True)
class Replayed:
    """One cloud and its answer."""

    header: Header
    answer: Localization


def replay(wanted: Replay, ask: Answerer, options: LocalizeOptions) -> Iterator[Replayed]:
    """Localizes the clouds one after the other, with one in memory.

    Raises:
        InvalidOption: gravity or the mounting is given by both the bag and the options; or several topics
            have clouds and none is chosen.
        NotFound: no such file, topic or static transform, or no cloud is left.
        MalformedData: the bag or a message in it is damaged.
    """
    if wanted.imu_topic is not None and options.gravity is not None:
        raise InvalidOption("give only one of --gravity and --imu-topic")
    if wanted.base_frame is not None and options.T_base_sensor is not None:
        raise InvalidOption("give only one of --T-base-sensor and --base-frame")
    with open_bag(wanted.path) as bag:
        topic = bag.cloud_topic(wanted.topic)
        if wanted.imu_topic is not None:
            bag.check_topic(wanted.imu_topic, imu.TYPE)
        if wanted.every < 1 or wanted.start_s < 0:
            raise InvalidOption("--every must be 1 or more, and --start 0 or more")
        number = -1
        for number, replayed in enumerate(_answers(bag, topic, wanted, ask, options)):  # noqa: B007
            yield replayed
        if number < 0:
            raise NotFound(f"{wanted.path}: {topic} has no cloud after {wanted.start_s:g} s")


def _answers(
    bag: Bag, topic: str, wanted: Replay, ask: Answerer, options: LocalizeOptions
) -> Iterator[Replayed]:
    frames = _static_transforms(bag) if wanted.imu_topic or wanted.base_frame else StaticTransforms()
    window = GravityWindow()
    topics = [topic, *([wanted.imu_topic] if wanted.imu_topic else [])]
    seen = 0
    for message in bag.messages(topics, bag.start_ns + round(wanted.start_s * 1e9)):
        if message.topic != topic:
            window.add(decode_imu(message.body, ros1=bag.ros1))
            continue
        seen += 1
        if (seen - 1) % wanted.every:
            continue
        stamped = _decoded(bag, message)
        asked = _with_gravity_and_mounting(options, stamped.header, window, frames, wanted.base_frame)
        yield Replayed(stamped.header, ask(stamped.scan(), asked))
        if wanted.count is not None and (seen - 1) // wanted.every + 1 >= wanted.count:
            return


def _decoded(bag: Bag, message: RawMessage) -> StampedCloud:
    try:
        return decode_point_cloud2(message.body, SCAN_LIMITS, ros1=bag.ros1)
    except MalformedData as error:
        raise MalformedData(f"{bag.path}: the message recorded at {message.time_ns} ns: {error}") from error


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


def _static_transforms(bag: Bag) -> StaticTransforms:
    frames = StaticTransforms()
    topics = [t for t in bag.topics(tf_message.TYPE) if t.rpartition("/")[2] == "tf_static"]
    for message in bag.messages(topics):
        frames.add(decode_transforms(message.body, ros1=bag.ros1))
    return frames


def write_tum(file: TextIO, replayed: Replayed) -> None:
    """Writes one line ``stamp x y z qx qy qz qw``: the robot's pose if it is known, else the sensor's."""
    answer = replayed.answer
    T = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    if T is not None:
        numbers = " ".join(f"{v:.9f}" for v in (*T[:3, 3], *quaternion_of(T)))
        file.write(f"{replayed.header.stamp} {numbers}\n")
