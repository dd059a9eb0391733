"""sqlite3 files and folders of ROS 2 as recorders leave them: changes beside them, wrong counts, parts."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections import namedtuple
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml

from firstfix.errors import MalformedData, TooLarge
from firstfix.recording.recording import open_recording
from tests.every_case import every_case
from tests.ros_samples import cdr, cloud_of_points, write_bag

S = 10**9
POINTS = [np.random.default_rng(n).normal(size=(50 + n, 3)).astype(np.float32) for n in range(6)]


def written(folder: Path, numbers: range = range(6), kind: str = "sqlite3") -> Path:
    folder.mkdir(exist_ok=True)
    return write_bag(folder, kind, [("/points", (n + 1) * S, cloud_of_points(POINTS[n])) for n in numbers])


def read(path: Path) -> tuple[list[int], list[str]]:
    """The clouds' times in seconds, and what was said."""
    with open_recording(path) as recording:
        clouds = list(recording.clouds(recording.cloud_topic(None)))
        for recorded in clouds:
            np.testing.assert_array_equal(recorded.cloud().cloud.xyz, POINTS[recorded.time_ns // S - 1])
        return [recorded.time_ns // S for recorded in clouds], recording.notes


def leave_beside(file: Path, mode: str, add: range) -> None:
    """Adds clouds as a recorder that is killed does: they are only in the file beside the database.

    Copies of the files of an open connection are what such a recorder leaves.
    """
    killed = file.with_name("killed")
    killed.mkdir()
    opened = sqlite3.connect(file)
    opened.execute(f"PRAGMA journal_mode = {mode}")
    opened.execute("PRAGMA wal_autocheckpoint = 0")
    opened.execute("PRAGMA cache_spill = 1")
    opened.execute("PRAGMA cache_size = 1")
    for n in add:
        opened.execute(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)",
            [(n + 1) * S, cdr(cloud_of_points(POINTS[n]))],
        )
    if mode == "WAL":
        opened.commit()
    for one in file.parent.glob(file.name + "*"):
        shutil.copyfile(one, killed / one.name)
    opened.close()
    for one in killed.iterdir():
        shutil.copyfile(one, file.parent / one.name)
    shutil.rmtree(killed)


@every_case("folder", [True, False])
def test_messages_in_a_wal_are_read_from_a_copy(tmp_path_factory: pytest.TempPathFactory, folder: bool):
    bag = written(tmp_path_factory.mktemp("bag"), range(3))
    (file,) = bag.glob("*.db3")
    leave_beside(file, "WAL", range(3, 6))
    before = {one.name: one.read_bytes() for one in bag.iterdir()}
    times, (note,) = read(bag if folder else file)
    assert times == [1, 2, 3, 4, 5, 6]
    assert "-wal holds new messages" in note
    assert {one.name: one.read_bytes() for one in bag.iterdir()} == before  # the recording is as it was


def test_a_change_that_was_not_finished_is_undone_in_a_copy(tmp_path: Path):
    bag = written(tmp_path, range(3))
    (file,) = bag.glob("*.db3")
    leave_beside(file, "DELETE", range(3, 6))
    assert file.with_name(file.name + "-journal").stat().st_size
    times, (note,) = read(bag)
    assert times == [1, 2, 3]
    assert "unfinished change" in note


def test_an_empty_wal_is_no_reason_for_a_copy(tmp_path: Path):
    bag = written(tmp_path)
    (file,) = bag.glob("*.db3")
    file.with_name(file.name + "-wal").write_bytes(b"")
    assert read(bag) == ([1, 2, 3, 4, 5, 6], [])


def test_a_copy_that_does_not_fit_is_refused_with_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    bag = written(tmp_path, range(3))
    (file,) = bag.glob("*.db3")
    leave_beside(file, "WAL", range(3, 6))
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**6, 0, 20_000))
    with (
        pytest.raises(TooLarge, match=r"sqlite3 \S+\.db3 'PRAGMA wal_checkpoint\(TRUNCATE\)'"),
        open_recording(bag),
    ):
        pass


def test_no_copy_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    bag = written(tmp_path, range(3))
    (file,) = bag.glob("*.db3")
    leave_beside(file, "WAL", range(3, 6))
    with open_recording(bag):
        assert len(list((tmp_path / "temporary").rglob("*.db3"))) == 1
    file.with_name(file.name + "-wal").write_bytes(b"no wal of this file" * 40)
    file.write_bytes(b"no database" * 400)
    with pytest.raises(MalformedData), open_recording(bag):
        pass
    assert not list((tmp_path / "temporary").iterdir())


def parts(folder: Path, kind: str, order: list[str]) -> Path:
    """A bag of three files with two clouds each, which its description lists in an order."""
    whole = folder / "whole"
    whole.mkdir()
    for number, letter in enumerate("abc"):
        bag = written(folder / letter, range(2 * number, 2 * number + 2), kind)
        (file,) = (one for one in bag.iterdir() if one.name != "metadata.yaml")
        ending = "." + file.name.partition(".")[2]
        file.rename(whole / f"{letter}{ending}")
    described = yaml.safe_load((bag / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"] = [
        f"{letter}{ending}" for letter in order
    ]
    for topic in described["rosbag2_bagfile_information"]["topics_with_message_count"]:
        topic["message_count"] = 0  # counts that were not written
    (whole / "metadata.yaml").write_text(yaml.safe_dump(described))
    return whole


@every_case("kind", ["sqlite3", "mcap", "mcap zstd file", "sqlite3 zstd file"])
def test_parts_are_read_in_the_order_of_time(tmp_path_factory: pytest.TempPathFactory, kind: str):
    """Also where the description counts no messages."""
    bag = parts(tmp_path_factory.mktemp("bag"), kind, ["c", "a", "b"])
    assert read(bag) == ([1, 2, 3, 4, 5, 6], [])


def test_a_missing_part_is_named(tmp_path: Path):
    bag = parts(tmp_path, "mcap", ["a", "b", "c"])
    (bag / "b.mcap").unlink()
    with pytest.raises(MalformedData, match=r"the file b\.mcap is missing"), open_recording(bag):
        pass


def test_a_name_with_signs_of_addresses_is_a_name(tmp_path: Path):
    """``?`` and ``%`` mean something in the addresses of sqlite."""
    (file,) = written(tmp_path).glob("*.db3")
    assert read(file.rename(tmp_path / "a?b%20c#d.db3"))[0] == [1, 2, 3, 4, 5, 6]


def test_files_that_the_description_does_not_name_are_named(tmp_path: Path):
    bag = parts(tmp_path, "sqlite3", ["a", "b"])
    times, (note,) = read(bag)
    assert times == [1, 2, 3, 4]
    assert "not read: c.db3. `ros2 bag reindex`" in note


def test_a_number_in_the_place_of_a_message_takes_no_memory(tmp_path: Path):
    """``bytes`` of a number are as many zeros."""
    (file,) = written(tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(file)) as opened, opened:
        opened.execute("UPDATE messages SET data = 1 << 40 WHERE id = 2")
    with pytest.raises(MalformedData, match="the data of a message is no bytes"):
        read(file)
