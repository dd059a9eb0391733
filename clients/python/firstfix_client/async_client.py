"""The HTTP client for asyncio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.scan.sequence import ScanSequence

from .async_calls import AsyncBuildCalls, AsyncMapCalls
from .policies import HedgePolicy, RetryPolicy
from .steps.http import HttpSteps, sent_headers
from .steps.localize import options_of
from .steps.scan_body import BodyForm, Encoding, ScanLike

if TYPE_CHECKING:
    import httpx

    from firstfix.scan.descriptor_parameters import DescriptorParameters


class AsyncClient(AsyncMapCalls, AsyncBuildCalls):
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
        from .drivers.async_http import AsyncHttp  # importing httpx takes as long as all the rest

        form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        self._steps = HttpSteps(url, timeout_s, retry, hedge, form)
        self._http = AsyncHttp(sent_headers(api_key, headers), transport)

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.close()

    async def localize(
        self,
        scan: ScanLike | ScanSequence,
        *,
        map_id: str,
        prior: Prior | None = None,
        gravity: ArrayLike | None = None,
        options: LocalizeOptions | None = None,
        encoding: Encoding = "scan",
        parameters: DescriptorParameters | None = None,
    ) -> Localization:
        """Returns the pose of a scan in a map, see ``Client.localize``."""
        form = BodyForm(encoding, parameters)
        return await self._http.run(
            self._steps.fixes.localize(scan, map_id, options_of(options, prior, gravity), form)
        )

    async def localize_body(
        self,
        body: bytes,
        media_type: str,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
        content_encoding: str | None = None,
        request_id: str | None = None,
    ) -> Localization:
        """Returns the answer to an encoded query, see ``Client.localize_body``."""
        return await self._http.run(
            self._steps.ask(
                body, media_type, map_id, options or LocalizeOptions(), content_encoding, request_id
            )
        )
