"""Bodies of files: long, but with a minimum pace."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest

from firstfix.errors import DeadlineExceeded
from firstfix_service.http_api.bodies import request_body
from firstfix_service.http_api.bodies.request_body import Pace, paced_pieces
from firstfix_service.http_api.parts import UploadParts
from tests.service.raw_connection import connect
from tests.service.service_world import serving
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


def received(monkeypatch: pytest.MonkeyPatch, *pieces: tuple[float, int], busy_s: float = 0.0) -> int:
    sender = Sender(*pieces)
    monkeypatch.setattr(request_body, "time", sender)

    async def run() -> int:
        total = 0
        async for piece in paced_pieces(sender, PACE):  # type: ignore[arg-type]
            total += len(piece)
            sender.now += busy_s
        return total

    return asyncio.run(run())


def test_a_steady_body_is_accepted_however_slowly_it_is_processed(monkeypatch):
    assert received(monkeypatch, *[(1.0, 1500)] * 500) == 750_000
    assert received(monkeypatch, *[(0.01, 10)] * 500, busy_s=60.0) == 5000


@pytest.mark.parametrize(
    ("pieces", "says"),
    [
        ([(1.0, 1)] * 100, "1 bytes/s, the minimum is 1000"),
        ([(1.0, 1 << 30), *[(1.0, 1)] * 100], "bytes/s"),
        ([(1.0, 2000)] * 3700, "within 3600 s"),
    ],
    ids=["drips", "slows down", "too long in all"],
)
def test_a_body_below_the_pace_is_given_up(monkeypatch, pieces, says):
    with pytest.raises(DeadlineExceeded, match=says):
        received(monkeypatch, *pieces)


@serving(zenoh=False, body_timeout_s=0.5, maps={})
@pytest.mark.parametrize("length", ["Content-Length: 5000", "Transfer-Encoding: chunked"])
def test_a_form_that_stalls_is_given_up(service, length):
    head = (
        f"POST /maps HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\n{length}\r\n\r\n"
    )
    with connect(service) as connection:
        connection.sendall(head.encode() + b"5\r\n--b\r\n\r\n")
        assert b" 504 " in connection.recv(4096).split(b"\r\n")[0]
    wait_until(lambda: list(service.settings.work_dir.glob("uploads/*")) == [])
    assert service.part(UploadParts).disks.promised_bytes == 0
