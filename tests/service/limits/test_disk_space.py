"""Disk space: reserved once, however many requests ask for it at the same time."""

from __future__ import annotations

import shutil
from collections import namedtuple
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from firstfix.catalog.uploads.parts import PART_BYTES
from firstfix.errors import OutOfSpace
from firstfix_service.http_api.parts import UploadParts
from firstfix_service.limits.disk_space import DiskSpace
from tests.service.callers_world import Caller
from tests.service.raw_connection import connect
from tests.service.service_world import serving
from tests.waiting import wait_until

MIB = 1 << 20
Usage = namedtuple("Usage", "total used free")
FORM = {"Content-Type": "multipart/form-data; boundary=b"}
over_http = serving(zenoh=False, max_upload_bytes=100 * MIB, maps={})


class Disk:
    """A disk of known size for ``shutil.disk_usage``. The folder's files are its used space."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.size_bytes = 1 << 60

    @property
    def used_bytes(self) -> int:
        return sum(path.stat().st_size for path in self._folder.rglob("*") if path.is_file())

    def leave(self, free_bytes: int) -> None:
        self.size_bytes = self.used_bytes + free_bytes

    def usage(self, _: object) -> Usage:
        used = self.used_bytes
        return Usage(self.size_bytes, used, self.size_bytes - used)


@pytest.fixture
def disk(tmp_path, monkeypatch) -> Disk:
    made = Disk(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", made.usage)
    return made


def test_free_bytes_are_reserved_once(tmp_path: Path, disk: Disk):
    disks = DiskSpace(10)
    disk.size_bytes = 110
    with ExitStack() as stack:
        first, second, third = (stack.enter_context(disks.reserve("d", tmp_path)) for _ in range(3))
        first.ensure(60)
        second.ensure(40)
        with pytest.raises(OutOfSpace, match="no room for 1 more"):
            third.ensure(1)
        with pytest.raises(OutOfSpace):
            first.ensure(61)
        assert disks.promised_bytes == 100
    assert disks.promised_bytes == 0
    with disks.reserve("d", tmp_path) as room:
        room.ensure(100)


def test_written_bytes_are_no_longer_reserved(tmp_path: Path, disk: Disk):
    """The disk itself counts the bytes as used."""
    disks = DiskSpace(0)
    disk.size_bytes = 100
    with disks.reserve("d", tmp_path) as first, disks.reserve("d", tmp_path) as second:
        first.ensure(60)
        for number in range(6):
            first.take(10)
            (tmp_path / f"{number}").write_bytes(bytes(10))
        second.ensure(30)
        assert disks.promised_bytes == 40, "the last ten may still be on their way"
        with pytest.raises(OutOfSpace):
            first.take(41)


def test_writing_stops_on_a_disk_that_others_fill(tmp_path: Path, disk: Disk):
    disk.size_bytes = 100
    with DiskSpace(10).reserve("d", tmp_path) as room:
        room.ensure(50)
        (tmp_path / "of another program").write_bytes(bytes(85))
        room.take(5)
        with pytest.raises(OutOfSpace):
            room.take(6)


def test_a_store_that_is_no_directory_has_any_room():
    with DiskSpace(10).reserve("s3", None) as room:
        room.ensure(1 << 60)
        room.take(1 << 60)


def form(*files: bytes) -> Iterator[bytes]:
    """A form in pieces, without a Content-Length."""
    yield b'--b\r\nContent-Disposition: form-data; name="map_id"\r\n\r\nhall\r\n'
    yield b'--b\r\nContent-Disposition: form-data; name="source"; filename="a.xyz"\r\n\r\n'
    yield from files
    yield b"\r\n--b--\r\n"


@over_http
def test_a_form_of_unknown_length_stops_at_the_reserve(service, disk: Disk):
    disk.leave(8 * MIB)
    free_bytes = []

    def pieces() -> Iterator[bytes]:
        for _ in range(20):
            free_bytes.append(disk.usage(None).free)
            yield bytes(MIB)

    answer = service.http.post("/maps", content=form(*pieces()), headers=FORM)
    assert (answer.status_code, answer.json()["code"]) == (507, "out_of_space")
    assert min(free_bytes) > 0
    assert service.catalog.builds.ids() == []
    wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
    assert service.part(UploadParts).disks.promised_bytes == 0
    assert service.http.post("/maps", content=form(bytes(2 * MIB)), headers=FORM).status_code == 202


@over_http
def test_a_form_needs_room_for_its_copy_in_the_store_too(service, disk: Disk):
    disk.leave(6 * MIB)
    for size, status in ((4 * MIB, 507), (2 * MIB, 202)):
        files = {"source": ("a.xyz", bytes(size))}
        assert service.http.post("/maps", data={"map_id": "hall"}, files=files).status_code == status


@over_http
def test_uploads_at_once_fit_only_as_far_as_they_have_room_together(service, disk: Disk):
    caller, size = Caller(service, "nobody-asks"), 3 * MIB
    urls = [caller.begin(size) for _ in range(4)]
    disk.leave(2 * size + MIB)
    assert caller.announce(3 * size).json()["code"] == "out_of_space"
    disks = service.part(UploadParts).disks
    with ExitStack() as under_way:
        for number, url in enumerate(urls[:2], 1):
            under_way.enter_context(caller.sending(url, size))
            wait_until(lambda number=number: disks.promised_bytes == number * size)
        for url in urls[2:]:
            refused = caller.send(url, bytes(size))
            assert (refused.status_code, refused.json()["code"]) == (507, "out_of_space")
            assert caller.call("HEAD", url).headers["upload-offset"] == "0"
    wait_until(lambda: disks.promised_bytes == 0)
    assert caller.send(urls[2], bytes(size)).status_code == 204


@over_http
def test_an_upload_needs_room_for_its_copy_among_the_sources(service, disk: Disk):
    caller = Caller(service, "nobody-asks")
    url = caller.begin(PART_BYTES // 4)
    assert caller.send(url, bytes(PART_BYTES // 4)).status_code == 204
    body = {"map_id": "hall", "source": {"upload": url.split("/")[-1]}}
    disk.leave(PART_BYTES // 4 - 1)
    assert service.http.post("/maps", json=body).json()["code"] == "out_of_space"
    disk.size_bytes += PART_BYTES
    assert service.http.post("/maps", json=body).status_code == 202


@over_http
def test_a_broken_form_releases_its_reserved_bytes(service, disk: Disk):
    disks = service.part(UploadParts).disks
    with connect(service) as connection:
        told = f"Content-Type: {FORM['Content-Type']}\r\nContent-Length: 5000"
        connection.sendall(f"POST /maps HTTP/1.1\r\nHost: x\r\n{told}\r\n\r\n--b\r\n".encode())
        wait_until(lambda: disks.promised_bytes == 2 * 5000)
    wait_until(lambda: disks.promised_bytes == 0)
    wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
