"""The HTTP client for asyncio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .async_calls import AsyncBuildCalls, AsyncFixCalls, AsyncMapCalls
from .policies import HedgePolicy, RetryPolicy
from .steps.http import HttpSteps, sent_headers
from .steps.scan_body import BodyForm

if TYPE_CHECKING:
    import httpx


class AsyncClient(AsyncFixCalls, AsyncMapCalls, AsyncBuildCalls):
    """Client of a firstfix service for asyncio, with the arguments, results and errors of ``Client``.

    Use it in one event loop, in an ``async with``, or await ``close``. A cancelled call closes its
    connection, and the service stops working on it. Scans are encoded in a thread.

    Args:
        transport: replaces the network in tests.
    """

    def __init__(
        self,
        url: str | Sequence[str],
        *,
        timeout_s: float = 10.0,
        retry: RetryPolicy | None = None,
        hedge: HedgePolicy | bool | None = None,
        resolution_m: float | None = None,
        voxel_m: float | None = None,
        api_key: str | None = None,
        headers: Mapping[str, str] | None = None,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        from .drivers.async_http import AsyncService  # importing httpx takes as long as all the rest

        form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        steps = HttpSteps(url, timeout_s, retry, hedge, form)
        self._service = AsyncService(steps, sent_headers(api_key, headers), transport)
