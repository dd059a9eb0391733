"""Disk space: reserved once, however many requests ask for it at the same time."""

from __future__ import annotations

import shutil
import socket
from collections import namedtuple
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from firstfix.catalog.uploads.parts import PART_BYTES
from firstfix.errors import OutOfSpace
from firstfix_service.http_api.parts import UploadParts
from firstfix_service.limits.disk_space import DiskSpace
from tests.service.callers_world import Caller
from tests.service.service_world import Service, running_service
from tests.waiting import wait_until

MIB = 1 << 20
Usage = namedtuple("Usage", "total used free")


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


class Disk:
    """A disk of known size for ``shutil.disk_usage``. The folder's files are its used space."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder = folder
        self.size_bytes = 1 << 60
        monkeypatch.setattr(shutil, "disk_usage", lambda path: self.usage())

    @property
    def used_bytes(self) -> int:
        return size_of(self._folder)

    def usage(self) -> Usage:
        used = self.used_bytes
        return Usage(self.size_bytes, used, self.size_bytes - used)


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(tmp_path, monkeypatch)


def test_the_same_bytes_are_promised_once(tmp_path: Path, disk: Disk):
    disks = DiskSpace(10)
    disk.size_bytes = 110
    with (
        disks.reserve("d", tmp_path) as first,
        disks.reserve("d", tmp_path) as second,
        disks.reserve("d", tmp_path) as third,
    ):
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


def test_what_was_written_is_not_promised_any_more(tmp_path: Path, disk: Disk):
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


def test_a_disk_that_others_fill_stops_what_is_written(tmp_path: Path, disk: Disk):
    disks = DiskSpace(10)
    disk.size_bytes = 100
    with disks.reserve("d", tmp_path) as room:
        room.ensure(50)
        (tmp_path / "of another program").write_bytes(bytes(85))
        room.take(5)
        with pytest.raises(OutOfSpace):
            room.take(6)


def test_a_store_that_is_no_directory_has_any_room():
    with DiskSpace(10).reserve("s3", None) as room:
        room.ensure(1 << 60)
        room.take(1 << 60)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, max_upload_bytes=100 * MIB) as running:
        yield running


def form(*files: bytes) -> Iterator[bytes]:
    """A form in pieces, without a Content-Length."""
    yield b'--b\r\nContent-Disposition: form-data; name="map_id"\r\n\r\nhall\r\n'
    yield b'--b\r\nContent-Disposition: form-data; name="source"; filename="a.xyz"\r\n\r\n'
    yield from files
    yield b"\r\n--b--\r\n"


FORM = {"Content-Type": "multipart/form-data; boundary=b"}


def test_a_form_that_does_not_tell_its_length_stops_at_the_reserve(service: Service, disk: Disk):
    disk.size_bytes = disk.used_bytes + 8 * MIB
    free_bytes = []

    def pieces() -> Iterator[bytes]:
        for _ in range(20):
            free_bytes.append(disk.usage().free)
            yield bytes(MIB)

    answer = service.http.post("/maps", content=form(*pieces()), headers=FORM)
    assert (answer.status_code, answer.json()["code"]) == (507, "out_of_space")
    assert min(free_bytes) > 0
    assert service.catalog.builds.ids() == []
    wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
    disks = service.app.state.start.parts[UploadParts].disks
    assert disks.promised_bytes == 0
    assert service.http.post("/maps", content=form(bytes(2 * MIB)), headers=FORM).status_code == 202


def test_a_form_needs_room_for_its_copy_in_the_store_as_well(service: Service, disk: Disk):
    disk.size_bytes = disk.used_bytes + 6 * MIB
    files = {"source": ("a.xyz", bytes(4 * MIB))}
    answer = service.http.post("/maps", data={"map_id": "hall"}, files=files)
    assert (answer.status_code, answer.json()["code"]) == (507, "out_of_space")
    files = {"source": ("a.xyz", bytes(2 * MIB))}
    assert service.http.post("/maps", data={"map_id": "hall"}, files=files).status_code == 202


def test_of_several_uploads_at_once_those_fit_that_have_room_together(service: Service, disk: Disk):
    """Each of them has room alone."""
    caller = Caller(service, "nobody-asks")
    size = 3 * MIB
    urls = [caller.begin(size) for _ in range(4)]
    disk.size_bytes = disk.used_bytes + 2 * size + MIB
    disks = service.app.state.start.parts[UploadParts].disks
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


def test_an_upload_needs_room_for_its_copy_among_the_sources(service: Service, disk: Disk):
    caller = Caller(service, "nobody-asks")
    url = caller.begin(PART_BYTES // 4)
    assert caller.send(url, bytes(PART_BYTES // 4)).status_code == 204
    body = {"map_id": "hall", "source": {"upload": url.split("/")[-1]}}
    disk.size_bytes = disk.used_bytes + PART_BYTES // 4 - 1
    assert service.http.post("/maps", json=body).json()["code"] == "out_of_space"
    disk.size_bytes += PART_BYTES
    assert service.http.post("/maps", json=body).status_code == 202


def test_a_form_that_breaks_off_gives_its_room_back(service: Service, disk: Disk):
    address = urlsplit(service.url)
    disks = service.app.state.start.parts[UploadParts].disks
    told = f"Content-Type: {FORM['Content-Type']}\r\nContent-Length: 5000"
    head = f"POST /maps HTTP/1.1\r\nHost: x\r\n{told}\r\n\r\n"
    with socket.create_connection((str(address.hostname), int(address.port or 0))) as connection:
        connection.sendall(head.encode() + b"--b\r\n")
        wait_until(lambda: disks.promised_bytes == 2 * 5000)
    wait_until(lambda: disks.promised_bytes == 0)
    wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
