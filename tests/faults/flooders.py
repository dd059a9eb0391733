"""The process of the caller that floods: it asks for all that it may, up to every limit that it has.

    python -m tests.faults.flooders 'heavy scans' --url URL --map yard --version DIGEST --key ffx_...

It asks this machine alone, from a loopback address of its own, at low priority: so that the other caller's
figures show the service, and not this process. Prints how often it met what, as JSON.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import json
import os
import signal
import socket
import sys
from asyncio import StreamReader, StreamWriter
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import numpy as np

OWN_ADDRESS = "127.0.0.66"
NICENESS = 10
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
    await _again(target.localize(12 * HEAVY_POINTS) + _heavy(), reader, writer, seen)


async def largest(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """The largest scans that a service takes."""
    await _again(target.localize(12 * LARGEST_POINTS) + _largest(), reader, writer, seen)


async def slow_bodies(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """A query whose body comes quickly, but for its end."""
    answer = asyncio.ensure_future(_status(reader))
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
    """Answers to queries that are not read."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    body = random_returns(500)
    while True:
        await _send(writer, target.localize(len(body)) + body)
        seen["asked"] += 1


async def broken_uploads(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """Uploads whose connection breaks in the middle, and what was begun is removed."""
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
    _, broken = await _connect(target.port)
    await _send(broken, target.head("PATCH", location, PART_BYTES, more) + bytes(PART_BYTES - 1))
    broken.transport.abort()
    await _send(writer, target.head("DELETE", location))
    seen[f"DELETE {await _status(reader)}"] += 1


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
            seen[await _status(reader)] += 1
            return
    seen["gone"] += 1


async def overlays(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Large scans to lay over the map."""
    path = f"{target.of_version}/overlay?T_map_sensor=0,0,1,0,0,0,1"
    body = random_returns(OVERLAY_POINTS)
    head = target.head("POST", path, len(body), f"Content-Type: {XYZ}\r\n")
    await _again(head + body, reader, writer, seen)


async def kept_queries(
    target: Target, reader: StreamReader, writer: StreamWriter, seen: Counter[str]
) -> None:
    """All kept queries, read one page after the other."""
    await _again(target.head("GET", "/samples?limit=100"), reader, writer, seen)


async def over_zenoh(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Heavy scans over zenoh, in a session of its own."""
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
            f"firstfix/{target.map_id}/localize",
            zenoh.handlers.Callback(reply, drop=lambda: loop.call_soon_threadsafe(told.release)),
            payload=_heavy(),
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
    "kept queries": Flood(kept_queries, 30),
    "zenoh": Flood(over_zenoh, 5),
}


async def flood(name: str, target: Target, seconds: float) -> Counter[str]:
    """Floods until SIGTERM, or for so many seconds. Returns how often it met what."""
    seen: Counter[str] = Counter()
    chosen = FLOODS[name]

    async def one() -> None:
        while True:
            try:
                reader, writer = await _connect(target.port)
            except OSError:
                seen["no connection"] += 1
                await asyncio.sleep(0.2)
                continue
            seen["connections"] += 1
            try:
                await chosen.act(target, reader, writer, seen)
            except (OSError, EOFError):
                seen["ended"] += 1
                await asyncio.sleep(0.05)
            finally:
                writer.transport.abort()

    told = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, told.set)
    tasks = [asyncio.create_task(one()) for _ in range(chosen.connections)]
    print("begun", flush=True)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(told.wait(), seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return seen


async def _connect(port: int) -> Connection:
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


async def _again(request: bytes, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Sends a request until the service closes the connection; its answers are counted even so."""
    while True:
        sending = asyncio.ensure_future(_send(writer, request))
        try:
            seen[await _status(reader)] += 1
            await sending
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)


async def _status(reader: StreamReader) -> str:
    """The status of an answer, which is read to its end."""
    head = await reader.readuntil(b"\r\n\r\n")
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


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests.faults.flooders", description=__doc__)
    parser.add_argument("flood", choices=FLOODS)
    parser.add_argument("--url", required=True)
    parser.add_argument("--endpoint", default="")
    parser.add_argument("--map", required=True, metavar="ID")
    parser.add_argument("--version", required=True, metavar="DIGEST")
    parser.add_argument("--key", required=True)
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    os.nice(NICENESS)
    target = Target(urlsplit(given.url).port or 80, given.endpoint, given.map, given.version, given.key)
    seen = asyncio.run(flood(given.flood, target, given.seconds))
    json.dump(seen, sys.stdout)
    sys.stdout.flush()
    os._exit(0)  # zenoh's threads may wait for a service that owes them replies


if __name__ == "__main__":
    main()
