"""The HTTP client: a fix from a running service, as a typed answer."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType

import httpx

from firstfix.errors import InvalidOption
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions
from firstfix.scan_sequence import ScanSequence

from .build_calls import BuildCalls
from .credential import credential
from .map_calls import MapCalls
from .retry import Deadline, RetryPolicy
from .retrying_http import RetryingHttp, parsed
from .scan_body import ScanLike, encoded


class Client(MapCalls, BuildCalls):
    """Asks a firstfix service over HTTP. Thread-safe; close it, or use it in a ``with``.

    Every call ends within its timeout, retries included: connections that fail and services that say
    "busy" (503) are tried again with growing, random waits. Besides what its docstring lists, every
    method raises the service's own error (``firstfix.errors``), DeadlineExceeded when the timeout is
    over, and ServiceUnreachable when no try reached a service.

    Args:
        url: of the service, such as ``http://localhost:8080``.
        timeout_s: of a call as a whole; uploads and waiting for builds have their own.
        retry: when to try again.
        resolution_m, voxel_m: how scans are sent, see ``firstfix.wire.encode_scan``. The default is what
            the sensor saw, to 1 cm; ``voxel_m=0.25`` saves most of the bytes on a thin link.
        api_key: an API key or a token of the service's issuer; None: FIRSTFIX_API_KEY of the environment, if
            it is there. Redirects are never followed, so nobody but the service gets it.
        headers: sent with every request.
        transport: in place of the network, for tests.
    """

    def __init__(
        self,
        url: str,
        *,
        timeout_s: float = 10.0,
        retry: RetryPolicy | None = None,
        resolution_m: float = 0.01,
        voxel_m: float | None = None,
        api_key: str | None = None,
        headers: Mapping[str, str] | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._timeout_s = timeout_s
        self._resolution_m, self._voxel_m = resolution_m, voxel_m
        try:
            address = httpx.URL(url)
        except httpx.InvalidURL as error:
            raise InvalidOption(f"no URL {url!r}: {error}") from None
        if address.scheme not in ("http", "https") or not address.host:
            raise InvalidOption(f"the service's URL is of the form http://HOST:PORT, not {url!r}")
        key = credential(api_key)
        sent = {**({} if key is None else {"Authorization": f"Bearer {key}"}), **(headers or {})}
        http = httpx.Client(base_url=address, headers=sent, transport=transport, follow_redirects=False)
        self._http = RetryingHttp(http, retry or RetryPolicy())

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def localize(
        self,
        scan: ScanLike | ScanSequence,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
    ) -> Localization:
        """The pose of a scan in a map, or why there is none: "not localized" is an answer, not an error.

        Args:
            scan: a Scan, (n, 3) points in metres in the sensor frame, the path of a scan file, or several
                scans with the way between them: the answer is then the pose of the last.
            options: without a ``deadline_ms`` the service is told how long this client waits.

        Raises:
            NotFound: no such map or version, or no such file.
            InputError: the scan or an option cannot be used.
        """
        media_type, body = encoded(scan, resolution_m=self._resolution_m, voxel_m=self._voxel_m)
        return self.localize_body(body, media_type, map_id=map_id, options=options)

    def localize_body(
        self,
        body: bytes,
        media_type: str,
        *,
        map_id: str,
        options: LocalizeOptions | None = None,
        content_encoding: str | None = None,
        request_id: str | None = None,
    ) -> Localization:
        """As ``localize``, of a query that is encoded already: the service gets these very bytes.

        Args:
            media_type, content_encoding: what the bytes are, as clients/PROTOCOL.md says.
            request_id: to find the query by in the service's log.
        """
        params = {"map": map_id, **(options or LocalizeOptions()).to_strings()}
        headers = {"Content-Type": media_type}
        if content_encoding:
            headers["Content-Encoding"] = content_encoding
        if request_id:
            headers["X-Request-Id"] = request_id

        def request(left_s: float) -> httpx.Request:
            return self._http.request(
                "POST",
                "localize",
                left_s=left_s,
                params={"deadline_ms": str(max(1, int(left_s * 1000))), **params},
                content=body,
                headers=headers,
            )

        answer = self._http.send(request, Deadline(self._timeout_s))
        return parsed(answer, Localization.from_mapping)
