"""Attacks: what a hostile caller does with one connection, again and again, in raw bytes.

Each attack gets an open connection and returns, or fails with what the service did to it.
"""

from __future__ import annotations

import asyncio
import itertools
import struct
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

DRIP_S = 1.0  # between two of the bytes of a slow one
SLOW_BYTES_PER_S = 750
FORM_BYTES = 1 << 20
SCAN = struct.pack("<3f", 3.0, 4.0, 1.0) * 400_000
_HOST = b"Host: firstfix\r\n"
_form_number = itertools.count()


@dataclass(frozen=True)
class Target:
    """The service's map and the attacker's key.

    Attributes:
        version: of the map.
        key: for attacks by a caller with permissions.
        points: number of points of the map's cloud that one request may ask for.
    """

    map_id: str
    version: str
    key: str
    points: int

    @property
    def authorization(self) -> bytes:
        return f"Authorization: Bearer {self.key}\r\n".encode()


Act = Callable[[Target, StreamReader, StreamWriter], Awaitable[None]]


@dataclass(frozen=True)
class Attack:
    """One kind of attack, and how often it is repeated.

    Attributes:
        connections: at the same time.
        rounds: on each connection's place, at most; then it stays away.
        addresses: number of loopback addresses that they come from.
    """

    act: Act
    connections: int
    rounds: int = 100
    addresses: int = 1


async def slow_head(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A header a second, without end."""
    await _send(writer, b"GET /healthz HTTP/1.1\r\n" + _HOST)
    while not reader.at_eof():
        await _send(writer, b"X-A: b\r\n")
        await asyncio.sleep(DRIP_S)


async def slow_body(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A query whose body comes a byte a second."""
    about = b"Content-Type: application/vnd.firstfix.xyz\r\nContent-Length: 120000\r\n\r\n"
    path = f"POST /localize?map={target.map_id} HTTP/1.1\r\n".encode()
    await _send(writer, path + _HOST + target.authorization + about)
    while not reader.at_eof():
        await _send(writer, b"x")
        await asyncio.sleep(DRIP_S)


async def unread_body(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A map without a key: its body goes on after the refusal."""
    await _send(writer, b"POST /maps HTTP/1.1\r\n" + _HOST + b"Content-Length: 1000000\r\n\r\n")
    await reader.readuntil(b"\r\n\r\n")
    while True:
        await _send(writer, b"x")
        await asyncio.sleep(DRIP_S)


async def empty_lines(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A good request, then empty lines for ever."""
    await _send(writer, b"GET /healthz HTTP/1.1\r\n" + _HOST + b"\r\n")
    await reader.readuntil(b"\r\n\r\n")
    while True:
        await _send(writer, b"\r\n")
        await asyncio.sleep(DRIP_S)


async def unread_answers(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Ask for long answers and takes none of them in."""
    transport = writer.transport
    transport.pause_reading()  # type: ignore[attr-defined]
    for _ in range(200):
        await _send(writer, b"GET /openapi.json HTTP/1.1\r\n" + _HOST + b"\r\n")
        await asyncio.sleep(DRIP_S)


async def unread_page(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Ask for the console's page without a key, with names that lead out of it too, and read nothing."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    for name in itertools.cycle((b"", b"..%2f..%2fapp.py", b"a" * 30_000, b"%00")):
        await _send(writer, b"GET /console/" + name + b" HTTP/1.1\r\n" + _HOST + b"\r\n")
        await asyncio.sleep(DRIP_S)


async def page(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """The console's page without a key, again and again, as fast as it comes."""
    await _ask_again(b"/console/", reader, writer)


async def refusal(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Requests without a key, each of which is refused."""
    await _ask_again(b"/caller", reader, writer)


async def probe(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Probes, as fast as they are answered."""
    await _ask_again(b"/healthz", reader, writer)


async def unread_stream(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A stream of live answers, with all that there are, of which nothing is taken in."""
    await _send(writer, b"GET /answers/events HTTP/1.1\r\n" + _HOST + target.authorization + b"\r\n")
    await reader.readuntil(b"\r\n\r\n")
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    while not writer.transport.is_closing():
        await asyncio.sleep(DRIP_S)


async def unread_points(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Ask for 4 MB of a map's cloud, and take nothing in."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    await _ask_for_points(target, writer)
    while not writer.transport.is_closing():
        await asyncio.sleep(DRIP_S)


async def slow_points(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Ask for 4 MB of a map's cloud, and take it in at the pace of a modem."""
    await _ask_for_points(target, writer)
    while taken := await reader.read(4096):
        writer.transport.pause_reading()  # type: ignore[attr-defined]
        await asyncio.sleep(len(taken) / SLOW_BYTES_PER_S)
        writer.transport.resume_reading()  # type: ignore[attr-defined]


async def overlay(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A large scan to lay over the map, as fast as it is taken."""
    path = f"/maps/{target.map_id}/versions/{target.version}/overlay?T_map_sensor=0,0,1,0,0,0,1"
    about = b"Content-Type: application/vnd.firstfix.xyz\r\nConnection: close\r\nContent-Length: %d\r\n\r\n"
    head = f"POST {path} HTTP/1.1\r\n".encode() + _HOST + target.authorization + about % len(SCAN)
    await _send(writer, head + SCAN)
    await reader.read()


async def long_head(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """9,000 headers in one send."""
    await _send(writer, b"GET /healthz HTTP/1.1\r\n" + _HOST + b"A: b\r\n" * 9000 + b"\r\n")
    await reader.read()
    await asyncio.sleep(DRIP_S)


async def silence(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """Open a connection and send nothing."""
    await reader.read()


async def upload(target: Target, reader: StreamReader, writer: StreamWriter) -> None:
    """A whole map of its own, as fast as it is taken."""
    content = b"%020d" % next(_form_number) + bytes(FORM_BYTES)
    form = b"".join(
        b'--B\r\nContent-Disposition: form-data; name="%s"%s\r\n\r\n%s\r\n' % field
        for field in (
            (b"map_id", b"", f"{target.map_id}-flood".encode()),
            (b"source", b'; filename="a.ply"', content),
        )
    )
    about = (
        b"Content-Type: multipart/form-data; boundary=B\r\nConnection: close\r\nContent-Length: %d\r\n\r\n"
    )
    form += b"--B--\r\n"
    await _send(writer, b"POST /maps HTTP/1.1\r\n" + _HOST + target.authorization + about % len(form) + form)
    await reader.read()


async def _ask_again(path: bytes, reader: StreamReader, writer: StreamWriter) -> None:
    while True:
        await _send(writer, b"GET " + path + b" HTTP/1.1\r\n" + _HOST + b"\r\n")
        head = await reader.readuntil(b"\r\n\r\n")
        length = head.lower().partition(b"content-length:")[2].partition(b"\r")[0]
        await reader.readexactly(int(length))


async def _ask_for_points(target: Target, writer: StreamWriter) -> None:
    path = f"/maps/{target.map_id}/versions/{target.version}/cloud/points?first=0&count={target.points}"
    await _send(writer, f"GET {path} HTTP/1.1\r\n".encode() + _HOST + target.authorization + b"\r\n")


async def _send(writer: StreamWriter, data: bytes) -> None:
    writer.write(data)
    await writer.drain()


ATTACKS = {
    "slow heads": Attack(slow_head, 200),
    "slow bodies": Attack(slow_body, 100),
    "unread bodies": Attack(unread_body, 200),
    "empty lines": Attack(empty_lines, 200),
    "unread answers": Attack(unread_answers, 50),
    "unread pages": Attack(unread_page, 50),
    "unread streams": Attack(unread_stream, 100),
    "unread points": Attack(unread_points, 500, rounds=1, addresses=2),
    "slow points": Attack(slow_points, 500, rounds=1, addresses=2),
    "floods of pages": Attack(page, 50),
    "floods of refusals": Attack(refusal, 50),
    "floods of probes": Attack(probe, 50),
    "floods of overlays": Attack(overlay, 16),
    "long heads": Attack(long_head, 20, rounds=20),
    "1,000 connections": Attack(silence, 1000),
    "floods of uploads": Attack(upload, 8, rounds=25),
}
