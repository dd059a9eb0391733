"""The HTTP client: a fix from a running service, as a typed answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType

import httpx

from firstfix.errors import DescriptorMismatch, InvalidOption, NotFound
from firstfix.localization import Localization
from firstfix.options import LocalizeOptions
from firstfix.query_parameters import QueryParameters
from firstfix.scan_sequence import ScanSequence

from .build_calls import BuildCalls
from .credential import credential
from .map_calls import MapCalls
from .retry import Deadline, RetryPolicy
from .retrying_http import RetryingHttp, parsed
from .scan_body import BodyForm, Encoding, ScanLike, encoded


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
        self._form = BodyForm(resolution_m=resolution_m, voxel_m=voxel_m)
        self._parameters: dict[str, QueryParameters] = {}  # of maps that were asked with a descriptor
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
        encoding: Encoding = "scan",
        parameters: QueryParameters | None = None,
    ) -> Localization:
        """The pose of a scan in a map, or why there is none: "not localized" is an answer, not an error.

        Args:
            scan: a Scan, (n, 3) points in metres in the sensor frame, the path of a scan file, or several
                scans with the way between them: the answer is then the pose of the last.
            options: without a ``deadline_ms`` the service is told how long this client waits.
            encoding: ``compact`` sends under 10 KB and is answered as well as the whole scan;
                ``descriptor`` sends under 1.5 KB and is answered with candidates, never ``localized``.
            parameters: of the map, for both of these. A descriptor needs those of its one map: where
                they are not given, the service is asked for them once, and again when the map changes.

        Raises:
            NotFound: no such map or version, or no such file.
            InputError: the scan or an option cannot be used.
        """
        if encoding != "descriptor" or parameters is not None:
            return self._localize(
                scan, map_id, options, replace(self._form, encoding=encoding, parameters=parameters)
            )
        known = map_id in self._parameters
        try:
            return self._localize(scan, map_id, options, self._described(map_id))
        except DescriptorMismatch:
            if not known:
                raise
            del self._parameters[map_id]  # another version is active by now
            return self._localize(scan, map_id, options, self._described(map_id))

    def query_parameters(self, map_id: str) -> QueryParameters:
        """How scans for the map's active version are described.

        Raises:
            NotFound: no such map, or no version of it is active.
            UnsupportedFormat: robots cannot describe scans for it.
        """
        manifest = self.show_map(map_id).details.get("manifest")
        if not isinstance(manifest, Mapping):
            raise NotFound(f"no version of map {map_id} is active")
        return QueryParameters.from_engine(manifest.get("engine", {}))

    def _described(self, map_id: str) -> BodyForm:
        if map_id not in self._parameters:
            self._parameters[map_id] = self.query_parameters(map_id)
        return replace(self._form, encoding="descriptor", parameters=self._parameters[map_id])

    def _localize(
        self, scan: ScanLike | ScanSequence, map_id: str, options: LocalizeOptions | None, form: BodyForm
    ) -> Localization:
        media_type, body = encoded(scan, form, None if options is None else options.gravity)
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
