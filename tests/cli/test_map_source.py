"""Sources as the command line hands them in: folders, and several sessions."""

from __future__ import annotations

import json
import zipfile

import pytest

from firstfix.errors import InvalidOption, NotFound
from firstfix_builder.sources.sessions.description import description_in, read_description
from firstfix_cli.map_source import GivenSession, as_one_file, session_folder


@pytest.fixture
def files(tmp_path):
    (tmp_path / "monday.pcd").write_bytes(b"1")
    (tmp_path / "tuesday").mkdir()
    (tmp_path / "tuesday/GlobalMap.pcd").write_bytes(b"2")
    (tmp_path / "tuesday/.hidden").write_bytes(b"4")
    (tmp_path / "tuesday.txt").write_bytes(b"3")
    return tmp_path


def test_sessions_become_a_folder_that_the_builder_reads(files):
    given = [
        GivenSession(files / "monday.pcd"),
        GivenSession.parse(f"{files / 'tuesday'},{files / 'tuesday.txt'}"),
    ]
    with session_folder(given) as folder:
        first, second = read_description(description_in(folder))
        assert (folder / first.source).read_bytes() == b"1"
        assert first.trajectory is None
        assert (folder / second.source / "GlobalMap.pcd").read_bytes() == b"2"
        assert (folder / second.trajectory).read_bytes() == b"3"
        assert first.source.endswith("monday.pcd")  # error messages name the session by it
    assert not folder.exists()


def test_files_of_the_same_name_do_not_meet(files):
    (files / "tuesday/monday.pcd").write_bytes(b"5")
    given = [GivenSession(files / "monday.pcd"), GivenSession(files / "tuesday/monday.pcd")]
    with session_folder(given) as folder:
        read = [(folder / one.source).read_bytes() for one in read_description(description_in(folder))]
    assert read == [b"1", b"5"]


@pytest.mark.parametrize("text", ["", ",poses.txt", "a.pcd,", "a.pcd,b.txt,c"])
def test_merge_takes_a_map_and_maybe_its_trajectory(text):
    with pytest.raises(InvalidOption, match="MAP or MAP,TRAJECTORY"):
        GivenSession.parse(text)


def test_a_session_that_is_not_there_is_named(files):
    with (
        pytest.raises(NotFound, match=r"wednesday\.pcd"),
        session_folder([GivenSession(files / "wednesday.pcd")]),
    ):
        pass


def test_a_folder_is_sent_as_an_archive(files):
    with as_one_file(files / "tuesday") as archive:
        assert archive.name == "tuesday.zip"
        with zipfile.ZipFile(archive) as opened:
            assert opened.namelist() == ["GlobalMap.pcd"]
        once = archive.read_bytes()
    (files / "tuesday/GlobalMap.pcd").touch()
    with as_one_file(files / "tuesday") as archive:
        assert archive.read_bytes() == once  # so that a repeated request is known as such
    assert not archive.exists()


def test_a_file_is_sent_as_it_is(files):
    with as_one_file(files / "monday.pcd") as file:
        assert file == files / "monday.pcd"


def test_the_folder_of_sessions_is_an_archive_too(files):
    with (
        session_folder([GivenSession(files / "monday.pcd")]) as folder,
        as_one_file(folder) as archive,
        zipfile.ZipFile(archive) as opened,
    ):
        listed = json.loads(opened.read("sessions.json"))["sessions"]
        assert opened.read(listed[0]["source"]) == b"1"
