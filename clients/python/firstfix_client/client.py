"""The blocking HTTP client."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .calls import BuildCalls, FixCalls, MapCalls
from .policies import HedgePolicy, RetryPolicy
from .steps.http import HttpSteps, sent_headers
from .steps.scan_body import BodyForm

if TYPE_CHECKING:
    import httpx


class Client(FixCalls, MapCalls, BuildCalls):
    """Client of a firstfix service over HTTP. Thread-safe. Close it, or use it in a ``with``.

    Every call ends within its timeout, retries included. It is tried again when a connection fails or
    breaks, or the service is busy (503): at once on another replica, after a wait on the same one.
    Besides the errors in its docstring, every method raises the service's own errors (``firstfix.errors``),
    DeadlineExceeded when the timeout is over, and ServiceUnreachable when the last try reached no service.

    Args:
        url: address of the service, such as ``http://localhost:8080``; several replicas as a list or
            separated by commas. The client picks one at random and keeps it until it fails.
        timeout_s: limit for one call. Uploads and builds have their own.
        retry: when to try again.
        hedge: when ``localize`` asks a second replica because the first is slow. The first answer wins and
            the other query is cancelled. None: ``HedgePolicy()`` if there are several URLs; True or a
            policy: with one URL too, since it may stand for many replicas; False: never.
        resolution_m, voxel_m: precision and thinning of whole scans, see ``firstfix.wire.scan.encode_scan``.
            The default keeps all points, to 1 cm, or to 2.5 cm in a range image; ``voxel_m=0.25`` saves
            most of the bytes on a thin link.
        api_key: an API key, or a token of the service's issuer; None: the environment's FIRSTFIX_API_KEY, if
            it is set. Redirects are never followed, so only the service gets it.
        headers: sent with every request.
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
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        from .drivers.blocking_http import BlockingService  # importing httpx takes as long as all the rest

        form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        steps = HttpSteps(url, timeout_s, retry, hedge, form)
        self._service = BlockingService(steps, sent_headers(api_key, headers), transport)
