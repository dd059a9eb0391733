"""Compressed bags: each file alone, damage, and what is small on the disk and endless in memory."""

from __future__ import annotations

import shutil
import tempfile
from collections import namedtuple
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from rosbags.rosbag2 import StoragePlugin, Writer

from firstfix.errors import InputError, MalformedData, TooLarge
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.recording import compression, messages
from firstfix.recording.recording import open_recording
from firstfix.ros.point_cloud2 import decode_point_cloud2
from tests import ros_samples
from tests.core.fixtures import in_memory_of
from tests.every_case import every_case
from tests.ros_samples import PACKED_BAG_KINDS, ROS2, cdr, cloud_of_points, write_bag

S = 10**9
POINTS = [np.random.default_rng(n).normal(size=(500 + n, 3)).astype(np.float32) for n in range(4)]
ROS2_KINDS = [kind for kind in PACKED_BAG_KINDS if not kind.startswith("ros1")]


def written(folder: Path, kind: str) -> Path:
    return write_bag(
        folder, kind, [("/points", (n + 1) * S, cloud_of_points(p)) for n, p in enumerate(POINTS)]
    )


def storage_file(bag: Path) -> Path:
    return next(path for path in bag.iterdir() if path.name != "metadata.yaml")


def read_sizes(path: Path) -> list[int]:
    with open_recording(path) as bag:
        clouds = [decode_point_cloud2(m.body, SCAN_LIMITS).cloud for m in bag.messages(["/points"])]
    for cloud, points in zip(clouds, POINTS, strict=True):
        np.testing.assert_array_equal(cloud.xyz, points)
    return [len(cloud) for cloud in clouds]


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_the_file_of_a_bag_is_read_without_its_folder(tmp_path: Path, kind: str):
    alone = shutil.move(storage_file(written(tmp_path, kind)), tmp_path)
    assert read_sizes(Path(alone)) == [len(points) for points in POINTS]


def test_a_bag_in_several_files_is_read_in_their_order(tmp_path: Path):
    whole = tmp_path / "whole"
    whole.mkdir()
    named = []
    for part in range(2):
        (tmp_path / str(part)).mkdir()
        clouds = [("/points", (n + 1) * S, cloud_of_points(POINTS[n])) for n in (2 * part, 2 * part + 1)]
        bag = write_bag(tmp_path / str(part), "mcap zstd file", clouds)
        named.append(f"whole_{part}.mcap.zstd")
        storage_file(bag).rename(whole / named[-1])
    described = yaml.safe_load((bag / "metadata.yaml").read_text())
    information = described["rosbag2_bagfile_information"]
    information |= {"relative_file_paths": named, "compression_mode": "FILE"}  # as rosbag2 itself writes it
    information["starting_time"]["nanoseconds_since_epoch"] = S
    (whole / "metadata.yaml").write_text(yaml.safe_dump(described))
    assert len(read_sizes(whole)) == 4
    (whole / named[0]).unlink()
    with pytest.raises(MalformedData, match=f"{named[0]} is missing"), open_recording(whole):
        pass


def test_nothing_is_left_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    bag = written(tmp_path, "sqlite3 zstd file")
    with open_recording(bag):
        assert len(list((tmp_path / "temporary").rglob("*.db3"))) == 1
    file = storage_file(bag)
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(MalformedData), open_recording(bag):
        pass
    assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_a_truncated_file_is_malformed(tmp_path: Path, kind: str):
    bag = written(tmp_path, kind)
    file = storage_file(bag)
    packed = file.read_bytes()
    for share in (0.0, 0.3, 0.9):
        file.write_bytes(packed[: int(share * len(packed))])
        with pytest.raises(MalformedData, match=str(bag)):
            read_sizes(bag)


def bag_of_message(folder: Path, body: bytes, plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A bag that says its messages are compressed, with this body."""
    path = folder / "bag"
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/points", ros_samples.CLOUD, typestore=ROS2)
        writer.write(connection, S, body)
    described = yaml.safe_load((path / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"] |= {"compression_mode": "MESSAGE", "compression_format": "zstd"}
    (path / "metadata.yaml").write_text(yaml.safe_dump(described))
    return path


def without_size(data: bytes) -> bytes:
    stream = zstandard.ZstdCompressor().compressobj()
    return stream.compress(data) + stream.flush()


GOOD = cdr(cloud_of_points(POINTS[0]))
BAD_MESSAGES = {
    "cut off": (zstandard.compress(GOOD)[:-5], "cut off"),
    "flipped": (zstandard.compress(GOOD)[:20] + b"\xff\xff" + zstandard.compress(GOOD)[22:], "zstd"),
    "followed by more": (zstandard.compress(GOOD) + b"more", "other bytes follow"),
    "of another packer": (lz4.frame.compress(GOOD), "encapsulation"),
}


@every_case("damage", BAD_MESSAGES)
def test_a_damaged_message_is_named(tmp_path_factory: pytest.TempPathFactory, damage: str):
    body, why = BAD_MESSAGES[damage]
    path = bag_of_message(tmp_path_factory.mktemp("bag"), body)
    with open_recording(path) as bag, pytest.raises(InputError, match=why) as raised:
        [decode_point_cloud2(message.body, SCAN_LIMITS) for message in bag.messages(["/points"])]
    assert damage == "of another packer" or f"the message of /points recorded at {S} ns" in str(raised.value)


def check_refused(path: Path, why: str, limit_bytes: float) -> None:
    """The bag is refused before Python's allocators hold so much memory."""
    with in_memory_of(int(limit_bytes)), pytest.raises(TooLarge, match=why), open_recording(path) as bag:
        list(bag.messages(["/points"]))


@every_case("pack", [zstandard.compress, without_size])
def test_a_message_cannot_take_memory_without_limit(tmp_path_factory: pytest.TempPathFactory, pack):
    bomb = pack(bytes(messages.MAX_MESSAGE_BYTES + 1))
    assert len(bomb) < 100_000
    path = bag_of_message(tmp_path_factory.mktemp("bag"), bomb)
    limit_bytes = messages.MAX_MESSAGE_BYTES
    check_refused(path, f"expands to over {limit_bytes}", 1.3 * limit_bytes)


CHUNKS = {"zstd": zstandard.compress, "zstd without its size": without_size, "lz4": lz4.frame.compress}


@every_case("name", CHUNKS)
def test_a_chunk_cannot_take_memory_without_limit(tmp_path_factory: pytest.TempPathFactory, name: str):
    """The chunk holds 40 times what its header declares."""
    path = tmp_path_factory.mktemp("bag") / "bag"
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.storage.compression = name.split()[0]
        writer.storage.compressor = lambda data: CHUNKS[name](data + bytes(39 * len(data)))
        connection = writer.add_connection("/points", ros_samples.CLOUD, typestore=ROS2)
        writer.write(connection, S, cdr(cloud_of_points(np.zeros((100_000, 3)))))
    check_refused(path, "expands to over 120", 25_000_000)


def test_the_declared_size_of_a_chunk_has_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compression, "MAX_CHUNK_BYTES", 3000)
    for kind in ("mcap zstd chunk", "mcap lz4 chunk", "ros1 lz4", "ros1 bz2"):
        stores = ros_samples.stores_of(kind)
        points = np.zeros((1000, 3))
        path = write_bag(tmp_path, kind, [("/points", S, cloud_of_points(points, stores=stores))])
        check_refused(path, "3000", 20_000_000)


def test_a_file_cannot_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**6, 0, 20_000))
    bag = written(tmp_path, "mcap zstd file")
    with pytest.raises(TooLarge, match=r"unpacks to over 10000 bytes.*TMPDIR"), open_recording(bag):
        pass


@every_case(
    "text",
    ["", "nonsense", "a: [", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {version: 5}"],
)
def test_an_invalid_description_is_malformed(tmp_path_factory: pytest.TempPathFactory, text: str):
    folder = tmp_path_factory.mktemp("bag")
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(MalformedData, match=r"metadata|Metadata|key"), open_recording(folder):
        pass


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_a_folder_without_metadata_is_read_by_its_files(tmp_path: Path, kind: str):
    """A recorder that is killed writes none."""
    bag = written(tmp_path, kind)
    (bag / "metadata.yaml").unlink()
    with open_recording(bag) as recording:
        (note,) = recording.notes
        assert "cut off" in note
    assert len(read_sizes(bag)) == 4
    storage_file(bag).unlink()
    with pytest.raises(MalformedData, match="not the folder of a ROS 2 bag"), open_recording(bag):
        pass
