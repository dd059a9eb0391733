"""A stand-in for a replica: answers every query, unless it is told to keep one.

It is told by files in a directory: ``keep`` (the replica that removes it keeps its query until its file
``<port>.kept`` is gone), and ``<port>.not_ready``.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

PORT, DIRECTORY = int(sys.argv[1]), Path(sys.argv[2])


async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while True:
            head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
            length = head.partition("content-length:")[2].split("\r\n")[0]
            await reader.readexactly(int(length or 0))
            ready = True
            if head.startswith("post"):
                await _keep_if_told()
            else:
                ready = not (DIRECTORY / f"{PORT}.not_ready").exists()
            status = b"200 OK" if ready else b"503 Service Unavailable"
            writer.write(b"HTTP/1.1 %s\r\nContent-Length: 2\r\n\r\nok" % status)
    except (asyncio.IncompleteReadError, ConnectionError):
        writer.close()


async def _keep_if_told() -> None:
    kept = DIRECTORY / f"{PORT}.kept"
    try:
        (DIRECTORY / "keep").rename(kept)
    except FileNotFoundError:
        return
    while kept.exists():
        await asyncio.sleep(0.02)


async def serve() -> None:
    server = await asyncio.start_server(answer, "127.0.0.1", PORT)
    await server.serve_forever()


asyncio.run(serve())
