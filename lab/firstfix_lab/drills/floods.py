"""Ways to flood a service: what one connection of a caller does that asks for all that it may."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import socket
from asyncio import StreamReader, StreamWriter
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

OWN_ADDRESS = "127.0.0.66"
XYZ = "application/vnd.firstfix.xyz"
HEAVY_POINTS, LARGEST_POINTS, OVERLAY_POINTS = 120_000, 2_000_000, 400_000
SLOW_BODY_BYTES = 6 << 20  # a hundred of them are more than all bodies may have
PART_BYTES = 1 << 20


def random_returns(points: int, seed: int = 0) -> bytes:
    """A legal scan that no map explains, so that it is searched for with all effort."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(points, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return (direction * rng.uniform(2, 30, (points, 1))).astype("<f4").tobytes()


@dataclass(frozen=True)
class Target:
    """The service, and the flooding caller's key.

    Attributes:
        endpoint: of zenoh.
    """

    port: int
    endpoint: str
    map_id: str
    version: str
    key: str

    def head(self, method: str, path: str, length: int | None = None, more: str = "") -> bytes:
        declared = "" if length is None else f"Content-Length: {length}\r\n"
        lines = f"{method} {path} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {self.key}\r\n{declared}{more}"
        return (lines + "\r\n").encode()

    def localize(self, length: int) -> bytes:
        return self.head("POST", f"/localize?map={self.map_id}", length, f"Content-Type: {XYZ}\r\n")

    @property
    def of_version(self) -> str:
        return f"/maps/{self.map_id}/versions/{self.version}"


Connection = tuple[StreamReader, StreamWriter]
Seen = Counter[str]  # how often it met what
Act = Callable[[Target, StreamReader, StreamWriter, Seen], Awaitable[None]]


async def scans(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Heavy scans, one after the other."""
    await again(target.localize(12 * HEAVY_POINTS) + _heavy(), reader, writer, seen)


async def largest(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """The largest scans that a service takes."""
    await again(target.localize(12 * LARGEST_POINTS) + _largest(), reader, writer, seen)


async def slow_bodies(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """A query whose body comes quickly, but for its end."""
    answer = asyncio.ensure_future(read_status(reader))
    try:
        with contextlib.suppress(OSError):
            await _send(writer, target.localize(SLOW_BODY_BYTES) + bytes(SLOW_BODY_BYTES - 1000))
            while not answer.done():
                await _send(writer, b"x")
                await asyncio.wait({answer}, timeout=1.0)
        seen[await answer] += 1
    finally:
        answer.cancel()
        await asyncio.gather(answer, return_exceptions=True)


async def unread_points(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """Large answers that are not read."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    path = f"{target.of_version}/cloud/points?first=0&count=500000"
    await _send(writer, target.head("GET", path) * 8)
    seen["asked"] += 8
    await asyncio.sleep(3600)


async def unread_scans(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """Answer to queries that are not read."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    body = random_returns(500)
    while True:
        await _send(writer, target.localize(len(body)) + body)
        seen["asked"] += 1


async def broken_uploads(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """Upload whose connection breaks in the middle, and what was begun is removed."""
    name = base64.b64encode(b"flood.xyz").decode()
    more = f"Upload-Length: {PART_BYTES}\r\nUpload-Metadata: filename {name}\r\n"
    await _send(writer, target.head("POST", "/uploads", 0, more))
    head = await reader.readuntil(b"\r\n\r\n")
    await _body(reader, head)
    seen[f"POST {_status_of(head)}"] += 1
    if b" 201 " not in head.partition(b"\r\n")[0]:
        return
    location = head.lower().partition(b"location: ")[2].partition(b"\r")[0].decode()
    more = "Content-Type: application/offset+octet-stream\r\nUpload-Offset: 0\r\n"
    _, broken = await connect(target.port)
    await _send(broken, target.head("PATCH", location, PART_BYTES, more) + bytes(PART_BYTES - 1))
    broken.transport.abort()
    await _send(writer, target.head("DELETE", location))
    seen[f"DELETE {await read_status(reader)}"] += 1


async def streams(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Streams of events, not read after their beginning."""
    await _send(writer, target.head("GET", "/answers/events"))
    head = await reader.readuntil(b"\r\n\r\n")
    seen[_status_of(head)] += 1
    if b" 200 " in head.partition(b"\r\n")[0]:
        writer.transport.pause_reading()  # type: ignore[attr-defined]
        await asyncio.sleep(3600)


async def cancelled(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Heavy queries whose caller goes."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(0.1):
            await _send(writer, target.localize(12 * HEAVY_POINTS) + _heavy())
            seen[await read_status(reader)] += 1
            return
    seen["gone"] += 1


async def overlays(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Large scans to lay over the map."""
    path = f"{target.of_version}/overlay?T_map_sensor=0,0,1,0,0,0,1"
    body = random_returns(OVERLAY_POINTS)
    head = target.head("POST", path, len(body), f"Content-Type: {XYZ}\r\n")
    await again(head + body, reader, writer, seen)


async def recorded_queries(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """All recorded queries, read one page after the other."""
    await again(target.head("GET", "/recorded-queries?limit=100"), reader, writer, seen)


async def over_zenoh(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Heavy scans over zenoh, in a session of its own."""
    await _over_zenoh(target, target.map_id, _heavy(), seen)


async def refused_by_zenoh(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Queries over zenoh that are refused at once, in a session of its own."""
    await _over_zenoh(target, "nothing", b"", seen)


async def _over_zenoh(target: Target, map_id: str, body: bytes, seen: Seen) -> None:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([target.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    loop = asyncio.get_running_loop()
    told = asyncio.Semaphore(0)

    def reply(one: Any) -> None:
        status = "200" if one.ok is not None else str(json.loads(one.err.payload.to_bytes()).get("status"))
        seen[status] += 1

    def ask() -> None:
        session.get(
            f"firstfix/{map_id}/localize",
            zenoh.handlers.Callback(reply, drop=lambda: loop.call_soon_threadsafe(told.release)),
            payload=body,
            encoding=XYZ,
            attachment=target.key,
            timeout=60,
        )

    try:
        for _ in range(20):
            ask()
        while True:
            await told.acquire()
            ask()
    finally:
        session.close()


@dataclass(frozen=True)
class Flood:
    """One way to flood, and on how many connections at the same time."""

    act: Act
    connections: int


FLOODS = {
    "heavy scans": Flood(scans, 60),
    "largest scans": Flood(largest, 12),
    "slow bodies": Flood(slow_bodies, 100),
    "unread points": Flood(unread_points, 100),
    "unread answers": Flood(unread_scans, 20),
    "broken uploads": Flood(broken_uploads, 8),
    "event streams": Flood(streams, 60),
    "cancelled queries": Flood(cancelled, 60),
    "overlays": Flood(overlays, 16),
    "recorded queries": Flood(recorded_queries, 30),
    "zenoh": Flood(over_zenoh, 5),
    "zenoh refusals": Flood(refused_by_zenoh, 5),
}


async def connect(port: int) -> Connection:
    """A connection that takes little in before its reader does."""
    own = socket.socket()
    own.setblocking(False)
    try:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.bind((OWN_ADDRESS, 0))
        await asyncio.get_running_loop().sock_connect(own, ("127.0.0.1", port))
        return await asyncio.open_connection(sock=own)
    except BaseException:
        own.close()
        raise


async def _send(writer: StreamWriter, data: bytes) -> None:
    writer.write(data)
    await writer.drain()


async def again(
    request: bytes, reader: StreamReader, writer: StreamWriter, seen: Seen, *, has_body: bool = True
) -> None:
    """Send a request until the service closes the connection; its answers are counted even so.

    Args:
        has_body: see ``read_status``.
    """
    while True:
        sending = asyncio.ensure_future(_send(writer, request))
        try:
            seen[await read_status(reader, has_body=has_body)] += 1
            await sending
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)


async def read_status(reader: StreamReader, *, has_body: bool = True) -> str:
    """The status of an answer, which is read to its end.

    Args:
        has_body: as its length says; not for HEAD, nor for a stream.
    """
    head = await reader.readuntil(b"\r\n\r\n")
    if has_body:
        await _body(reader, head)
    return _status_of(head)


def _status_of(head: bytes) -> str:
    return head.split(b" ", 2)[1].decode()


async def _body(reader: StreamReader, head: bytes) -> None:
    length = head.lower().partition(b"content-length:")[2].partition(b"\r")[0]
    await reader.readexactly(int(length or 0))


def _once(points: int) -> Callable[[], bytes]:
    made: list[bytes] = []

    def body() -> bytes:
        if not made:
            made.append(random_returns(points))
        return made[0]

    return body


_heavy, _largest = _once(HEAVY_POINTS), _once(LARGEST_POINTS)
