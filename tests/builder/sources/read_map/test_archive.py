from __future__ import annotations

import errno
import stat
import zipfile
from collections import Counter

import numpy as np
import pytest

from firstfix.errors import FirstfixError, MalformedData, OutOfSpace, TooLarge, UnsupportedFormat
from firstfix_builder.sources.read_map import archive
from firstfix_builder.sources.read_map.archive import unpack


def zipped(path, files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            made.writestr(name, content)
    return path


def test_a_folder_comes_out_as_it_went_in(tmp_path):
    found = unpack(zipped(tmp_path / "a.zip", {"map.pcd": b"1", "poses/p.txt": b"2"}), tmp_path / "out")
    assert (found / "map.pcd").read_bytes() == b"1"
    assert (found / "poses/p.txt").read_bytes() == b"2"


def test_an_archive_of_one_folder_is_this_folder(tmp_path):
    found = unpack(zipped(tmp_path / "a.zip", {"hall/map.pcd": b"1", "hall/p.txt": b"2"}), tmp_path / "out")
    assert sorted(path.name for path in found.iterdir()) == ["map.pcd", "p.txt"]


def test_what_macos_adds_to_an_archive_does_not_count(tmp_path):
    files = {"hall/map.pcd": b"1", "hall/.DS_Store": b"2", "__MACOSX/hall/._map.pcd": b"3", ".DS_Store": b"4"}
    found = unpack(zipped(tmp_path / "a.zip", files), tmp_path / "out")
    assert found.name == "hall"
    assert sorted(path.name for path in found.iterdir()) == ["map.pcd"]


def test_a_folder_of_mapping_scans_stays_in_the_folder_of_its_map(tmp_path):
    found = unpack(zipped(tmp_path / "a.zip", {"mapping_scans/poses.csv": b"1"}), tmp_path / "out")
    assert (found / "mapping_scans" / "poses.csv").exists()


@pytest.mark.parametrize("name", ["../map.pcd", "/map.pcd", "a/../../map.pcd", "a\\..\\map.pcd"])
def test_nothing_is_written_outside_the_folder(tmp_path, name):
    with pytest.raises(MalformedData, match="leads out"):
        unpack(zipped(tmp_path / "a.zip", {name: b"1"}), tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zip", "out"]


def test_a_link_is_refused(tmp_path):
    entry = zipfile.ZipInfo("map.pcd")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as made:
        made.writestr(entry, "/etc/passwd")
    with pytest.raises(MalformedData, match="not a regular file"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"no archive at all"])
def test_a_file_that_is_no_archive_is_malformed(tmp_path, content):
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(MalformedData, match=r"a\.zip"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_a_file_and_a_folder_of_one_name_are_malformed(tmp_path):
    for number, files in enumerate(({"a": b"1", "a/b": b"2", "c": b""}, {"a/b": b"2", "a": b"1", "c": b""})):
        with pytest.raises(MalformedData, match="a file and a folder have the same name"):
            unpack(zipped(tmp_path / f"{number}.zip", files), tmp_path / f"out{number}")


def test_an_empty_archive_is_refused(tmp_path):
    with pytest.raises(MalformedData, match="no file"):
        unpack(zipped(tmp_path / "a.zip", {}), tmp_path / "out")


@pytest.mark.parametrize(
    ("limit", "value", "files", "why"),
    [
        ("MAX_BYTES", 1_000_000, {"map.pcd": bytes(900_000), "more.pcd": bytes(900_000)}, "unpacked"),
        ("MAX_FILES", 3, dict.fromkeys("abcd", b""), "4 files"),
        ("MAX_DIRECTORY_BYTES", 100, dict.fromkeys("abc", b"1"), "a list of files"),
    ],
)
def test_an_archive_beyond_a_limit_is_too_large(tmp_path, monkeypatch, limit, value, files, why):
    monkeypatch.setattr(archive, limit, value)
    with pytest.raises(TooLarge, match=why):
        unpack(zipped(tmp_path / "a.zip", files), tmp_path / "out")


def damaged(path, rng):
    raw = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 4))):
        place, size = int(rng.integers(len(raw))), int(rng.integers(1, 9))
        raw[place : place + size] = rng.choice([b"\0", b"\xff", rng.bytes(1)]) * size
    path.write_bytes(raw)


def test_whatever_zipfile_raises_about_damage_is_malformed(tmp_path):
    """OSError for a negative place, IndexError for an empty name, and others."""
    rng = np.random.default_rng(0)
    ends = Counter()
    for number in range(400):
        path = zipped(tmp_path / f"{number}.zip", {"hall/map.pcd": b"1" * 30, "hall/poses.txt": b"2"})
        damaged(path, rng)
        try:
            unpack(path, tmp_path / f"out{number}")
            ends["unpacked"] += 1
        except FirstfixError as error:
            ends[type(error)] += 1
    assert ends[MalformedData] > 100


def test_an_entry_without_a_name_is_malformed(tmp_path):
    raw = zipped(tmp_path / "a.zip", {"m": b"1"}).read_bytes()
    at = raw.index(b"PK\1\2")
    raw = raw[: at + 28] + b"\0\0" + raw[at + 30 : at + 46] + raw[at + 47 :]
    end = raw.index(b"PK\5\6")
    size = int.from_bytes(raw[end + 12 : end + 16], "little") - 1
    (tmp_path / "a.zip").write_bytes(raw[: end + 12] + size.to_bytes(4, "little") + raw[end + 16 :])
    with pytest.raises(MalformedData, match=r"a\.zip"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_what_does_not_fit_on_the_disk_is_not_begun(tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 10})
    monkeypatch.setattr(archive.shutil, "disk_usage", lambda folder: usage)
    with pytest.raises(OutOfSpace, match="11 bytes unpacked, and the disk has 10"):
        unpack(zipped(tmp_path / "a.zip", {"map.pcd": bytes(11)}), tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_a_disk_that_fills_up_is_no_damage(tmp_path, monkeypatch):
    def full(opened, entry, target, left):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(archive, "_write", full)
    with pytest.raises(OutOfSpace, match=r"a\.zip: the work disk is full"):
        unpack(zipped(tmp_path / "a.zip", {"map.pcd": b"1"}), tmp_path / "out")


def test_a_packing_that_reserves_memory_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_LZMA) as made:
        made.writestr("map.pcd", b"1")
    with pytest.raises(UnsupportedFormat, match="packed by method 14"):
        unpack(tmp_path / "a.zip", tmp_path / "out")
