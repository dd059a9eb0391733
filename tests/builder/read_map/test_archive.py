from __future__ import annotations

import stat
import zipfile

import pytest

from firstfix.errors import MalformedData, TooLarge
from firstfix_builder.read_map import archive
from firstfix_builder.read_map.archive import unpack


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
def test_what_is_no_archive(tmp_path, content):
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(MalformedData, match=r"a\.zip"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_a_damaged_file_in_it(tmp_path):
    path = zipped(tmp_path / "a.zip", {"map.pcd": bytes(range(256)) * 20})
    raw = bytearray(path.read_bytes())
    raw[60:80] = bytes(20)
    path.write_bytes(raw)
    with pytest.raises(MalformedData, match=r"a\.zip"):
        unpack(path, tmp_path / "out")


def test_a_file_where_another_has_its_folder(tmp_path):
    for number, files in enumerate(({"a": b"1", "a/b": b"2", "c": b""}, {"a/b": b"2", "a": b"1", "c": b""})):
        with pytest.raises(MalformedData, match="a file and a folder have the same name"):
            unpack(zipped(tmp_path / f"{number}.zip", files), tmp_path / f"out{number}")


def test_an_empty_archive(tmp_path):
    with pytest.raises(MalformedData, match="no file"):
        unpack(zipped(tmp_path / "a.zip", {}), tmp_path / "out")


def test_a_bomb_is_stopped_by_what_comes_out(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MAX_BYTES", 1_000_000)
    path = zipped(tmp_path / "a.zip", {"map.pcd": bytes(900_000), "more.pcd": bytes(900_000)})
    assert path.stat().st_size < 10_000
    with pytest.raises(TooLarge, match="unpacked"):
        unpack(path, tmp_path / "out")


def test_too_many_files(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MAX_FILES", 3)
    with pytest.raises(TooLarge, match="4 files"):
        unpack(zipped(tmp_path / "a.zip", {f"{n}": b"" for n in range(4)}), tmp_path / "out")
