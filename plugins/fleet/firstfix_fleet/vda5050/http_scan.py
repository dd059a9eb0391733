"""Scan of a vehicle over HTTP: one GET, bounded in size and time, without redirects."""

from __future__ import annotations

import asyncio
import ssl

import httpx

from firstfix.errors import MalformedData, TooLarge
from firstfix.scan_formats import MEDIA_TYPES

MAX_SCAN_BYTES = 64 << 20
TIMEOUT_S = 10.0


def fetch_scan(url: str, media_type: str, tls: ssl.SSLContext) -> tuple[bytes, str]:
    """The body and its media type: the answer's own, if it is one of a scan, else the given one.

    Raises:
        ConnectionError: no answer, or not all of it in time.
        MalformedData: an answer without a scan.
        TooLarge: more than MAX_SCAN_BYTES.
    """
    try:
        # A loop of its own: a limit of each step alone would let a host hold the thread for days.
        return asyncio.run(asyncio.wait_for(_fetch(url, media_type, tls), TIMEOUT_S))
    except (TimeoutError, asyncio.TimeoutError):
        raise ConnectionError(f"its scan did not come within {TIMEOUT_S:g} s") from None
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise ConnectionError(
            f"its scan's URL does not answer: {str(error) or type(error).__name__}"
        ) from None


async def _fetch(url: str, media_type: str, tls: ssl.SSLContext) -> tuple[bytes, str]:
    async with (
        httpx.AsyncClient(verify=tls, headers={"Accept-Encoding": "identity"}) as client,
        client.stream("GET", url) as answer,
    ):
        if answer.status_code != httpx.codes.OK:
            raise MalformedData(f"its scan's URL answers with status {answer.status_code}")
        body = bytearray()
        async for part in answer.aiter_raw(1 << 16):
            body += part
            if len(body) > MAX_SCAN_BYTES:
                raise TooLarge(f"its scan has more than {MAX_SCAN_BYTES} bytes")
        own = answer.headers.get("Content-Type", "")
        return bytes(body), own if own.partition(";")[0].strip().lower() in MEDIA_TYPES else media_type
