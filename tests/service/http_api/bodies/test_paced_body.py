"""Bodies of files: long, but with a minimum pace."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from firstfix.errors import DeadlineExceeded
from firstfix_service.http_api.bodies import request_body
from firstfix_service.http_api.bodies.request_body import Pace, paced_pieces
from firstfix_service.http_api.parts import UploadParts
from tests.service.service_world import running_service
from tests.waiting import wait_until

PACE = Pace(stall_s=30.0, min_bytes_per_s=1000, timeout_s=3600.0)


class Sender:
    """A request whose body arrives at given times of a clock that it sets itself."""

    def __init__(self, *pieces: tuple[float, int]) -> None:
        self._pieces = pieces
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    async def stream(self) -> AsyncIterator[bytes]:
        for waited_s, size in self._pieces:
            self.now += waited_s
            yield bytes(size)


def received(monkeypatch: pytest.MonkeyPatch, sender: Sender, pace: Pace = PACE, busy_s: float = 0.0) -> int:
    monkeypatch.setattr(request_body, "time", sender)

    async def run() -> int:
        total = 0
        async for piece in paced_pieces(sender, pace):  # type: ignore[arg-type]
            total += len(piece)
            sender.now += busy_s
        return total

    return asyncio.run(run())


def test_a_steady_body_comes_whole(monkeypatch: pytest.MonkeyPatch):
    assert received(monkeypatch, Sender(*[(1.0, 1500)] * 500)) == 750_000


def test_a_byte_now_and_then_is_no_progress(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(DeadlineExceeded, match="1 bytes/s, the minimum is 1000"):
        received(monkeypatch, Sender(*[(1.0, 1)] * 100))


def test_a_body_that_slows_down_is_given_up_then(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(DeadlineExceeded, match="bytes/s"):
        received(monkeypatch, Sender((1.0, 1 << 30), *[(1.0, 1)] * 100))


def test_time_that_this_side_takes_is_not_the_senders(monkeypatch: pytest.MonkeyPatch):
    assert received(monkeypatch, Sender(*[(0.01, 10)] * 500), busy_s=60.0) == 5000


def test_all_of_it_has_its_time(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(DeadlineExceeded, match="within 3600 s"):
        received(monkeypatch, Sender(*[(1.0, 2000)] * 3700))


@pytest.mark.parametrize("length", ["Content-Length: 5000", "Transfer-Encoding: chunked"])
def test_a_form_that_stalls_is_given_up(tmp_path: Path, length: str):
    with running_service(tmp_path, zenoh=False, body_timeout_s=0.5) as service:
        address = urlsplit(service.url)
        told = f"Content-Type: multipart/form-data; boundary=b\r\n{length}"
        head = f"POST /maps HTTP/1.1\r\nHost: x\r\n{told}\r\n\r\n"
        with socket.create_connection((str(address.hostname), int(address.port or 0))) as connection:
            connection.settimeout(60)
            connection.sendall(head.encode() + b"5\r\n--b\r\n\r\n")
            assert b" 504 " in connection.recv(4096).split(b"\r\n")[0]
        wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
        assert service.app.state.start.parts[UploadParts].disks.promised_bytes == 0
